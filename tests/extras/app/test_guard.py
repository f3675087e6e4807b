"""Other origins, missing tokens, names that point at this machine, paths that lead out, floods: none gets in."""

import json
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tests.extras.app.conftest import WATCHDOG_S, Client
from uavcover.extras.app import commands
from uavcover.extras.app.command import POLICY

ROUTES = (
    "/",
    "/api/state",
    "/page/app.js",
    "/vendor/maplibre-gl/maplibre-gl.css",
    "/files/valley.toml",
    "/tiles/heights/8/1/1.png",
)


@pytest.mark.parametrize("path", ROUTES)
@pytest.mark.parametrize(
    "wrong",
    [
        {"Cookie": None},
        {"Cookie": "uavcover-1=a-token-of-the-tests"},
        {"Cookie": "uavcover={token}x"},
        {"Host": "uavcover.example"},
        {"Host": "127.0.0.1.example:80"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "null"},
        {"Origin": "http://evil.example"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
    ids=str,
)
def test_others_are_refused(served: Client, path: str, wrong: dict[str, str | None]) -> None:
    status, headers, body = served.ask(
        "GET", path, None, **{name.replace("-", "_"): value for name, value in wrong.items()}
    )
    assert status == 403
    assert b"403: " in body
    assert b"token-of" not in body
    assert headers["content-security-policy"] == POLICY


def test_a_change_needs_the_origin(served: Client) -> None:
    body = {"kind": "verify", "run": "x"}
    assert served.ask("POST", "/api/jobs", body, Origin=None)[0] == 403
    assert served.ask("POST", "/api/jobs", body)[0] == 400


def test_the_token_opens_the_page_and_becomes_a_cookie(served: Client) -> None:
    status, headers, body = served.ask("GET", f"/?token={served.token}", None, Cookie=None)
    assert status == 200
    assert b"uavcover" in body
    assert headers["set-cookie"] == f"uavcover-{served.port}={served.token}; Path=/; HttpOnly; SameSite=Strict"
    assert served.ask("GET", "/?token=wrong", None, Cookie=None)[0] == 403
    assert served.ask("GET", f"/api/state?token={served.token}", None, Cookie=None)[0] == 403, (
        "only for the page itself"
    )


OUTSIDE = (
    "../secret.toml",
    "a/../../secret.toml",
    "/etc/passwd",
    "..",
    ".",
    "",
    "\\..\\secret",
    "valley.toml\x00",
    "link.toml",
    "folder/secret.toml",
    ".hidden.toml",
    ".uavcover/jobs",
)


@pytest.mark.parametrize("name", OUTSIDE, ids=repr)
def test_no_path_leads_out_of_the_folder(served: Client, name: str) -> None:
    secret = served.root.parent / "secret.toml"
    secret.write_text("[area]\nsecret = 1\n")
    (served.root / ".hidden.toml").write_text("[area]\nsecret = 1\n")
    (served.root / "link.toml").symlink_to(secret)
    (served.root / "folder").symlink_to(served.root.parent)
    from urllib.parse import quote

    quoted = quote(name, safe="")
    for method, path, body in (
        ("GET", f"/api/scene?name={quoted}", None),
        ("GET", f"/api/area?name={quoted}", None),
        ("GET", f"/tiles/background/1/0/0?file={quoted}", None),
        ("GET", f"/tiles/heights/8/1/1.png?dem={quoted}", None),
        ("POST", "/api/jobs", {"kind": "plan", "scenario": name}),
        ("POST", "/api/jobs", {"kind": "verify", "run": name}),
        ("POST", "/api/design", {"area": name or "..", "dem": [name]}),
    ):
        status, _, answer = served.ask(method, path, body)
        assert status in (200, 400)
        assert b"secret = 1" not in answer
        if status == 200:
            assert any(
                words in json.loads(answer)["error"] for words in ("inside", "begin with a dot or a dash", "draw")
            )
    status, _, answer = served.ask("GET", f"/files/{quoted}")
    assert status in (400, 404)
    assert b"secret = 1" not in answer
    assert served.server.jobs.all() == []


def test_the_listing_shows_nothing_from_elsewhere(served: Client) -> None:
    (served.root.parent / "secret.toml").write_text("[area]\n")
    (served.root / "link.toml").symlink_to(served.root.parent / "secret.toml")
    (served.root / "folder").symlink_to(served.root.parent)
    names = [entry["name"] for entries in served.get("/api/state")["files"].values() for entry in entries]
    assert "valley.toml" in names
    assert not [name for name in names if "link" in name or "folder" in name or "secret" in name]


def test_a_file_is_never_a_page_of_this_origin(served: Client) -> None:
    (served.root / "report.html").write_text("<script>alert(1)</script>")
    status, headers, _ = served.ask("GET", "/files/report.html")
    assert status == 200
    assert headers["content-type"] == "application/octet-stream"
    assert headers["content-disposition"].startswith("attachment")
    assert headers["x-content-type-options"] == "nosniff"


def test_an_upload_that_is_too_large_is_refused_before_and_while_it_comes(
    served: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "MOST_UPLOAD_BYTES", 1000)
    before = sorted(path.name for path in served.root.iterdir())
    status, _, body = served.ask("PUT", "/api/files/large.tif", b"x" * 1001)
    assert status == 413
    assert b"copy it into the folder" in body
    # A length that is not told, or is a lie, is found out by counting.
    status, _, _ = served.ask(
        "PUT", "/api/files/large.tif", iter_of(b"x" * 600, b"x" * 600), Transfer_Encoding="chunked"
    )
    assert status == 413
    assert sorted(path.name for path in served.root.iterdir() if path.name != ".uavcover") == before
    assert not list((served.root / ".uavcover").glob("*.half"))


@pytest.mark.parametrize("query", ["", "?photo_of=run"])
def test_an_upload_of_a_gigabyte_is_refused_before_its_first_byte(served: Client, query: str) -> None:
    (served.root / "run").mkdir()
    (served.root / "run" / "plan.json").write_text("{}")
    status, _, body = served.ask("PUT", f"/api/files/large.jpg{query}", b"", Content_Length=str(1 << 30))
    assert status == 413
    assert b"copy it into the folder" in body


def test_photos_are_kept_in_the_run_folder_and_have_a_limit_in_all(
    served: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = served.root / "run"
    run.mkdir()
    (run / "plan.json").write_text("{}")
    monkeypatch.setattr(commands, "MOST_PHOTO_BYTES", 1000)
    for name, size, code in (("a.jpg", 600, 200), ("b.jpg", 600, 413), ("a.jpg", 900, 200), ("c.jpg", 100, 200)):
        assert served.ask("PUT", f"/api/files/{name}?photo_of=run", b"x" * size)[0] == code, name
    assert sorted((path.name, path.stat().st_size) for path in (run / "photos").iterdir()) == [
        ("a.jpg", 900),
        ("c.jpg", 100),
    ]
    for name in ("page.html", "x.toml", ".jpg", "..%2Fa.jpg%2F..", "a.jpg%00"):
        status, _, _ = served.ask("PUT", f"/api/files/{name}?photo_of=run", b"x")
        assert status == 400, name
    for name in ("..", "valley.toml", "none", "%2Fetc", ".uavcover"):
        assert served.ask("PUT", f"/api/files/d.jpg?photo_of={name}", b"x")[0] == 400, name
    assert [each["name"] for each in served.get("/api/state")["files"]["areas"]] == ["valley.geojson"]


def test_a_photo_folder_that_leads_outside_is_refused(served: Client) -> None:
    run, outside = served.root / "run", served.root.parent / "outside"
    run.mkdir()
    outside.mkdir()
    (run / "plan.json").write_text("{}")
    (run / "photos").symlink_to(outside)
    assert served.ask("PUT", "/api/files/d.jpg?photo_of=run", b"x")[0] == 400
    assert not list(outside.iterdir())


def iter_of(*chunks: bytes) -> bytes:
    return b"".join(f"{len(chunk):x}\r\n".encode() + chunk + b"\r\n" for chunk in chunks) + b"0\r\n\r\n"


def test_an_upload_replaces_nothing(served: Client) -> None:
    before = (served.root / "valley.toml").read_bytes()
    status, _, body = served.ask("PUT", "/api/files/valley.toml", b"other")
    assert status == 200
    assert json.loads(body)["name"] == "valley-2.toml"
    assert (served.root / "valley.toml").read_bytes() == before


def test_a_full_disk_is_an_error_of_one_line(served: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "rename", full)
    status, _, body = served.ask("PUT", "/api/files/a.kml", b"x")
    assert status == 507
    assert b"No space left" in body


@pytest.mark.parametrize("body", [b"[1]", b"{", b"\xff", b"null", b"{" + b'"a":' * 30000 + b"1" + b"}" * 30000])
def test_a_request_that_is_no_object_is_refused(served: Client, body: bytes) -> None:
    status, _, _ = served.ask("POST", "/api/design", body)
    assert status in (400, 413)


def socket_of(served: Client, **headers: str) -> connect:
    given = {"Cookie": f"uavcover-{served.port}={served.token}", **headers}
    return connect(
        f"ws://{served.host}/ws", origin=headers.pop("Origin", f"http://{served.host}"), additional_headers=given
    )  # type: ignore[arg-type]


def test_a_socket_of_another_origin_or_without_the_token_is_refused(served: Client) -> None:
    with pytest.raises(InvalidStatus):
        connect(
            f"ws://{served.host}/ws",
            origin="http://evil.example",
            additional_headers={"Cookie": f"uavcover-{served.port}={served.token}"},
        )  # type: ignore[arg-type]
    with pytest.raises(InvalidStatus):
        connect(f"ws://{served.host}/ws", origin=f"http://{served.host}")  # type: ignore[arg-type]


def test_a_flood_of_messages_ends_the_connection_and_not_the_server(served: Client) -> None:
    def all_of(*messages: str) -> None:
        with socket_of(served) as socket:
            for message in messages:
                socket.send(message)
            while True:
                socket.recv(timeout=WATCHDOG_S)

    with pytest.raises(ConnectionClosed):
        all_of(*['{"leave": "x"}'] * 2000)
    with pytest.raises(ConnectionClosed):
        all_of("x" * 70000)
    assert served.get("/api/state")["folder"] == served.root.name


@pytest.mark.parametrize(
    "message",
    [
        "",
        "[]",
        "1",
        '{"watch": 3}',
        '{"watch": "../x"}',
        '{"job": "../x"}',
        '{"from": "x", "watch": "y"}',
        '{"watch": {}}',
    ],
)
def test_a_message_that_is_wrong_is_answered(served: Client, message: str) -> None:
    with socket_of(served) as socket:
        socket.send(message)
        while "error" not in (answer := json.loads(socket.recv(timeout=WATCHDOG_S))):
            pass
        assert answer["error"]


def test_a_word_for_the_command_line_is_never_an_option(served: Client) -> None:
    (served.root / "--force").mkdir()
    (served.root / "--force" / "plan.json").write_text("{}")
    for body in (
        {"kind": "verify", "run": "--force"},
        {"kind": "plan", "scenario": "valley.toml", "budget": "--help"},
        {"kind": "plan", "scenario": "valley.toml", "select": "-x"},
        {"kind": "nothing"},
        {"kind": "fly", "run": "valley", "to": "--yes"},
    ):
        assert served.error("POST", "/api/jobs", body)
    assert served.server.jobs.all() == []


def test_a_real_vehicle_is_not_flown_unless_the_server_allows_it(served: Client) -> None:
    run = served.root / "run"
    run.mkdir()
    (run / "plan.json").write_text("{}")
    requested = {"kind": "fly", "run": "run", "to": "udp:127.0.0.1:14550", "confirmed": "udp:127.0.0.1:14550"}
    assert "--allow-flight" in served.error("POST", "/api/jobs", requested)
    served.server.flights_allowed = True
    assert "type the vehicle's address" in served.error("POST", "/api/jobs", {**requested, "confirmed": "yes"})
    assert served.server.jobs.all() == []
