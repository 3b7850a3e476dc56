"""The client in Python of a link: what its users do by mistake is named."""

import pathlib
import signal
import sys
import threading

import numpy as np
import pytest

import arlequin as aq
from arlequin import errors

CLIENT = pathlib.Path(__file__).resolve().parents[3] / "apps" / "link" / "clients" / "python"


def test_the_client_in_python_says_what_is_wrong(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(CLIENT))
    import arlequin_link

    cells = np.array([[0, 1], [1, 2]])
    for places in (lambda w: w.mean(cells), lambda w: w.at([0.0, 1.0])):
        with pytest.raises(ValueError, match=r"give coordinates, nodes or nodes\[cells\]"):
            places(arlequin_link.Weights().internal)
    monkeypatch.delenv("ARLEQUIN_LINK", raising=False)
    for address in (None, "localhost:7"):
        with pytest.raises(ValueError, match="unix:PATH or tcp:IP:PORT"):
            arlequin_link.serve(None, address)
    # Cut at a whole character.
    assert arlequin_link.text("a" + "ü" * 600)[4:].decode() == "a" + "ü" * 511
    script = tmp_path / "mine.py"
    script.write_text(
        f"import sys\nsys.path.insert(0, {str(CLIENT)!r})\nfrom chain import Chain, serve\n"
        "class Mine(Chain):\n    def weigh(self, weights):\n        open('/no/such/file')\n"
        "serve(Mine(-20.0, 1.0, 60, 1.0, 1.0))\n"
    )
    with pytest.raises(errors.Error, match="failed: FileNotFoundError"):
        aq.Subdomain.remote("mine", [sys.executable, str(script)])


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")
def test_ctrl_c_while_a_solver_is_awaited_is_not_lost():
    timer = threading.Timer(0.1, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        aq.Subdomain.remote("mine", [sys.executable, "-c", "import time; time.sleep(9)"], timeout=0.3)
    timer.join()
