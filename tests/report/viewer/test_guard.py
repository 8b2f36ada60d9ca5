"""The guard of the viewer's server: a request without the token gets neither files nor the websocket."""

from __future__ import annotations

import socket
import threading

import pytest

from simspec.errors import SpecError
from simspec.report.viewer.guard import LOOPBACK, Guard, port_problem, serving

GUARD = Guard("secret-token")
HOST = "127.0.0.1:8080"


@pytest.mark.parametrize(
    ("path", "inner"),
    [
        ("/secret-token", "/"),
        ("/secret-token/", "/"),
        ("/secret-token/index.html", "/index.html"),
        ("/secret-token/?websocket=ws://127.0.0.1/secret-token", "/?websocket=ws://127.0.0.1/secret-token"),
        ("/secret-token?a=b/c", "/?a=b/c"),
        ("/", None),
        ("", None),
        ("/secret-toke", None),
        ("/secret-token2/", None),
        ("//secret-token/", None),
        ("/index.html", None),
        ("/?secret-token", None),
        ("/x/secret-token/", None),
        ("/%73ecret-token/", None),
        ("/sécret-token/", None),
    ],
)
def test_the_path_begins_with_the_token(path, inner):
    assert GUARD.inner_path(path) == inner


@pytest.mark.parametrize(
    ("hosts", "origins", "refused"),
    [
        ([HOST], [], False),
        (["localhost:8080"], [], False),
        ([HOST], [f"http://{HOST}"], False),
        ([], [], True),
        ([HOST, HOST], [], True),
        (["example.org"], [], True),
        (["example.org:8080"], ["http://example.org:8080"], True),
        (["127.0.0.1.example.org:8080"], [], True),
        ([HOST], ["http://example.org"], True),
        ([HOST], ["null"], True),
        ([HOST], ["http://localhost:8080"], True),
        ([HOST], ["http://127.0.0.1:9999"], True),
        ([HOST], ["https://127.0.0.1:8080"], True),
        ([HOST], [f"http://{HOST}", "http://example.org"], True),
    ],
)
def test_other_sites_are_refused_even_with_the_token(hosts, origins, refused):
    assert GUARD.refuses("/secret-token/", hosts, origins) is refused


def test_every_server_has_a_token_that_cannot_be_guessed():
    tokens = {Guard().token for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 32


def test_a_port_in_use_is_named():
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert "address already in use" in port_problem(port).message
        pytest.importorskip("viser", reason="viser is not installed (extra view)")
        before = threading.active_count()
        with pytest.raises(SpecError, match=f"--port {port}: address already in use"), serving(port, "x"):
            pass
        assert threading.active_count() == before  # no server was started
    assert port_problem(0) is None


def test_a_server_that_cannot_be_guarded_is_stopped(monkeypatch):
    viser = pytest.importorskip("viser", reason="viser is not installed (extra view)")
    made = []

    class Other:
        """A server that starts in a way of its own."""

        def __init__(self, **options):
            made.append("started")

        def stop(self):
            made.append("stopped")

    monkeypatch.setattr(viser, "ViserServer", Other)
    with pytest.raises(RuntimeError, match="cannot be guarded"), serving(0, "x"):
        pass
    assert made == ["started", "stopped"]
