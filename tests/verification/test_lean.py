"""An attitude fits the motion, or it is not known: flights of a point mass with drag in wind, and attitudes that were made up."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavcover.verification.attitude import LeanProblem, lean_problem
from uavcover.verification.lean_fit import thrust_m_s2

GRAVITY = 9.80665
STEP_S = 0.2


def test_thrust_is_that_of_the_turned_vehicle() -> None:
    attitude = np.random.default_rng(1).uniform([-50, -50, 0], [50, 50, 360], (200, 3))
    for (roll, pitch, yaw), found in zip(attitude, thrust_m_s2(attitude), strict=True):
        # North, east, down: the thrust of a vehicle is against its own down.
        north, east, down = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).apply([0.0, 0.0, -1.0])
        np.testing.assert_allclose(found, [GRAVITY * east / -down, GRAVITY * north / -down], atol=1e-9)


def flight(
    *,
    brisk_m_s2: float = 2.5,
    drag_per_s: float = 0.3,
    wind_m_s: tuple[float, float] = (3.0, -2.0),
    gust_m_s: float = 0.0,
    noise_m: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, places and attitudes of lines there and back at 10 m/s, nose ahead, with the attitudes that this takes."""
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 240.0, STEP_S)
    # Legs of different lengths: reversed in time it would be another flight.
    turns_s = [23.0, 58.0, 84.0, 121.0, 149.0, 188.0, 211.0]
    course = np.where(np.searchsorted(turns_s, time_s) % 2 < 1, 1.0, -1.0)
    wanted = np.column_stack([0.5 * np.ones_like(course), 10.0 * course])
    velocity = np.zeros((len(time_s), 2))
    for k in range(1, len(time_s)):
        step = np.clip(wanted[k] - velocity[k - 1], -brisk_m_s2 * STEP_S, brisk_m_s2 * STEP_S)
        velocity[k] = velocity[k - 1] + step
    positions = np.column_stack([np.cumsum(velocity, axis=0) * STEP_S, np.full(len(time_s), 80.0)])
    acceleration = np.gradient(np.gradient(positions[:, :2], STEP_S, axis=0), STEP_S, axis=0)
    gusts = np.cumsum(rng.normal(0.0, gust_m_s * np.sqrt(2.0 * STEP_S / 5.0), (len(time_s), 2)), axis=0)
    gusts -= np.linspace(0.0, 1.0, len(time_s))[:, None] * gusts[-1]
    thrust = acceleration + drag_per_s * (velocity - np.array(wind_m_s) - np.clip(gusts, -4.0, 4.0))
    yaw = np.degrees(np.arctan2(0.05, course)) % 360.0
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    ahead, right = s * thrust[:, 0] + c * thrust[:, 1], c * thrust[:, 0] - s * thrust[:, 1]
    pitch = -np.arctan(ahead / GRAVITY)
    roll = np.arctan(right * np.cos(pitch) / GRAVITY)
    positions[:, :2] += rng.normal(0.0, noise_m, (len(time_s), 2)) if noise_m else 0.0
    return time_s, positions, np.column_stack([np.degrees(roll), np.degrees(pitch), yaw])


def problem_of(
    flown: tuple[np.ndarray, np.ndarray, np.ndarray], attitude: np.ndarray | None = None
) -> LeanProblem | None:
    time_s, positions, own = flown
    joined = np.ones(len(time_s) - 1, dtype=bool)
    return lean_problem(time_s, positions, joined, own if attitude is None else attitude)


@pytest.mark.parametrize("drag_per_s", [0.0, 0.2, 0.5, 0.9])
@pytest.mark.parametrize("wind", [(0.0, 0.0), (6.0, 0.0), (-4.0, 5.0)])
def test_what_was_flown_fits(drag_per_s: float, wind: tuple[float, float]) -> None:
    assert problem_of(flight(drag_per_s=drag_per_s, wind_m_s=wind)) is None


@pytest.mark.parametrize(("gust", "noise"), [(1.0, 0.0), (2.0, 0.0), (0.0, 0.1), (1.0, 0.2)])
def test_gusts_and_noise_fit(gust: float, noise: float) -> None:
    assert problem_of(flight(gust_m_s=gust, noise_m=noise)) is None


T = np.arange(0.0, 240.0, STEP_S)
SWAY = np.sin(2.0 * np.pi * T / 5.0)
TO_AND_FRO = np.sign(np.sin(2.0 * np.pi * T / 17.0))
JUMPING = np.random.default_rng(2).normal(0.0, 40.0, len(T) // 10).repeat(10)


def turned(*, roll: object = 0.0, pitch: object = 0.0, yaw: object = 0.0) -> Callable[[np.ndarray], np.ndarray]:
    def change(attitude: np.ndarray) -> np.ndarray:
        return attitude + np.column_stack([np.broadcast_to(angle, len(attitude)) for angle in (roll, pitch, yaw)])

    return change


FALSE: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "rolled by 15 degrees": (turned(roll=15.0), "to one side on all headings"),
    "rolled by -9 degrees": (turned(roll=-9.0), "to one side on all headings"),
    "pitched up by 30 degrees": (turned(pitch=30.0), "against the direction of flight"),
    "mirrored": (lambda a: a * [-1.0, -1.0, 1.0], "against the direction of flight"),
    "turned about": (turned(yaw=180.0), "against the direction of flight"),
    "swaying": (turned(roll=30.0 * SWAY), "do not match the flown accelerations"),
    "nodding": (turned(pitch=30.0 * SWAY), "do not match the flown accelerations"),
    "rolled to and fro": (turned(roll=25.0 * TO_AND_FRO), "do not match the flown accelerations"),
    "jumping": (turned(pitch=JUMPING), "do not match the flown accelerations"),
}


@pytest.mark.parametrize("name", FALSE)
def test_what_was_made_up_does_not(name: str) -> None:
    change, why = FALSE[name]
    flown = flight()
    found = problem_of(flown, change(flown[2]))
    assert found is not None
    assert why in found.text
    assert found.samples.all()


REVERSED = np.arange(len(T))[::-1]


def at_another_time(late_s: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(attitude: np.ndarray) -> np.ndarray:
        lean = [np.interp(T - late_s, T, axis) for axis in attitude[:, :2].T]
        return np.column_stack([*lean, attitude[:, 2]])

    return change


UNMEASURED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "reversed in time": lambda a: np.column_stack([a[REVERSED, :2], a[:, 2]]),
    "5 s late": at_another_time(5.0),
    "2 s late": at_another_time(2.0),
    "3 s early": at_another_time(-3.0),
    "a third": lambda a: a / [3.0, 3.0, 1.0],
    "twice": lambda a: a * [2.0, 2.0, 1.0],
    "exchanged": lambda a: a[:, [1, 0, 2]],
    "noise": lambda a: np.column_stack([np.random.default_rng(5).normal(0.0, 3.0, (len(T), 2)), a[:, 2]]),
    "another heading": lambda a: np.column_stack([a[:, :2], a[:, 2] + 90.0]),
}
"""Small enough on a gentle flight to leave little unexplained."""


@pytest.mark.parametrize("name", UNMEASURED)
@pytest.mark.parametrize("brisk_m_s2", [0.8, 2.5])
@pytest.mark.parametrize("gust", [0.0, 0.5])
def test_a_small_residual_is_no_measurement(name: str, brisk_m_s2: float, gust: float) -> None:
    flown = flight(brisk_m_s2=brisk_m_s2, gust_m_s=gust)
    assert problem_of(flown) is None
    found = problem_of(flown, UNMEASURED[name](flown[2]))
    assert found is not None
    assert found.samples.all()


def test_without_manoeuvres_an_attitude_is_not_confirmed() -> None:
    steady = np.column_stack([10.0 * T, 0.0 * T, np.full(len(T), 80.0)])
    noise = np.random.default_rng(6).normal(0.0, 0.3, (len(T), 2))
    found = problem_of((T, steady, np.column_stack([noise, np.full(len(T), 90.0)])))
    assert found is not None
    assert found.kind == "unconfirmed"


def test_a_part_that_was_made_up_is_not_known_and_the_rest_is() -> None:
    flown = flight()
    attitude = flown[2].copy()
    made_up = (T >= 60.0) & (T < 100.0)
    attitude[made_up, 0] += 25.0
    found = problem_of(flown, attitude)
    assert found is not None
    assert "for about 40 s" in found.text
    assert found.samples[made_up].all()
    assert found.samples.mean() < 0.2


@pytest.mark.parametrize("degrees", [-4.0, 4.0])
def test_an_autopilot_that_is_mounted_a_little_askew_fits(degrees: float) -> None:
    flown = flight()
    assert problem_of(flown, flown[2] + [degrees, 0.0, 0.0]) is None


def test_on_one_heading_a_steady_lean_may_be_the_winds() -> None:
    time_s, positions, attitude = flight()
    one_line = slice(0, round(22.0 / STEP_S))
    leaning = attitude[one_line] + [12.0, 0.0, 0.0]
    assert problem_of((time_s[one_line], positions[one_line], leaning)) is None


def test_little_or_nothing_known_confirms_nothing() -> None:
    time_s, positions, attitude = flight()
    sparse = slice(None, None, 20)  # a sample in 4 s
    for few in (
        (time_s, positions, np.full_like(attitude, np.nan)),
        (time_s[:10], positions[:10], attitude[:10]),
        (time_s[sparse], positions[sparse], -attitude[sparse]),
    ):
        found = problem_of(few)
        assert found is not None
        assert found.kind == "unconfirmed"
