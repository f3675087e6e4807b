"""A run over a surface model, from `new` to the verdict: what is recorded of it, and that a changed one is noticed."""

import json

import pytest

from tests.scenario.surface_files import WOOD_M, lon_lat, write_models
from uavcover.errors import InputError
from uavcover.new.command import new_scenario, print_design
from uavcover.new.elevation_questions import NewRequest
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import inspect_inputs, refuse_changes
from uavcover.run.user import Unattended
from uavcover.scenario.areas.area_file import AreaQuery


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A folder with both models, and a run of a small survey over the corner of the wood. Not to be changed."""
    folder = tmp_path_factory.mktemp("surface")
    files = write_models(folder)
    (west, south), (east, north) = lon_lat(180.0, 200.0), lon_lat(300.0, 300.0)
    request = NewRequest(
        area=AreaQuery(source=f"{west},{south},{east},{north}"), dem=(str(files.ground),), dsm=(str(files.surface),),
        camera="dji-m3e", gsd="2.5cm", overlap="60/50", margin="0",
    )  # fmt: skip
    new = new_scenario(request, Unattended(), folder=folder)
    said = print_design(new, Unattended())
    run = folder / "run"
    plan_into(
        PlanRequest(scenario=new.site, folder=run, command=["test"], force=False, evaluations=60),
        Unattended(),
        check_site=lambda _: None,
    )
    return folder, new, said


def test_new_makes_room_for_the_trees_and_says_what_they_hide(planned):
    _, new, said = planned
    limits = new.site.scenario.limits
    assert limits.max_height_agl_m - limits.min_height_agl_m >= WOOD_M + 2.0 * limits.height_margin_m
    assert said["tallest_m"] == pytest.approx(WOOD_M, abs=0.5)
    # The wood covers the eastern 50 of 120 metres.
    assert said["hidden_share"] == pytest.approx(50.0 / 120.0, abs=0.03)
    assert new.site.ground_model is not None
    position = new.site.home_m[None, :2]
    assert abs(float((new.site.ground.heights_m(position) - new.site.bare_ground.heights_m(position))[0])) < 0.5
    assert 'surface_file = "dsm.tif"' in new.text


def test_the_run_names_the_surface_model_and_a_changed_one_is_refused(planned):
    folder, new, _ = planned
    run = RunFolder(folder / "run")
    document = json.loads(run.file("run.json").read_text())
    assert document["inputs"]["surface"]["sha256"] == new.site.ground.surface_sha256
    assert document["inputs"]["terrain"]["sha256"] == new.site.bare_ground.sha256
    inputs = inspect_inputs(run, [])
    refuse_changes(run, inputs, ())
    assert inputs.hashes["surface"] == new.site.ground.surface_sha256
    surface = folder / "dsm.tif"
    before = surface.read_bytes()
    try:
        surface.write_bytes(before + b" ")
        with pytest.raises(InputError, match=r"dsm\.tif was .*--accept-changed surface"):
            refuse_changes(run, inspect_inputs(run, []), ())
        surface.unlink()
        with pytest.raises(InputError, match=r"dsm\.tif was .* gone"):
            refuse_changes(run, inspect_inputs(run, []), ())
    finally:
        surface.write_bytes(before)
