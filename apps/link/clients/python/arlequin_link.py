"""A solver in Python as a participant of an Arlequin run, over a socket: numpy alone (docs/link.md has the protocol).

Derive from Solver and call `serve(MySolver())`. A run whose scene says `command = ["python3", "mine.py"]` starts the script
and tells it the address in ARLEQUIN_LINK; else pass the address of the scene, "unix:PATH" or "tcp:127.0.0.1:PORT".
Arrays have one number per unknown: x0 y0 z0 x1 ... (x0 x1 ... with one component), then rotations. SI units.
"""
import os
import socket
import struct
import time

import numpy as np

VERSION, LIMIT = 1, 1 << 30
HELLO, WEIGH, SHARES, ADVANCE, IMPULSE, TELL, SAVE, RESTORE, END = range(1, 10)
DESCRIPTION, ASK, INERTIA, STATE, RECORD, DONE, WORKING, FAILED = range(65, 73)
V, Q, A, INVARIANT, MEMORY = 1, 2, 4, 8, 16
CORNERS = {"particles": 2, "line": 2, "tetrahedron": 4, "hexahedron": 8}


class Solver:
    """What a solver has; it must have these methods, and may have those of the last line.

    weigh(weights): take weights.internal (stiffness) and weights.kinetic (mass) by .at(points) or .mean(cells), and return the
        lumped inertia of every unknown [kg]; called with weights of one first.
    advance(time, step): go on from time by step [s]; self.link.working() tells the run to wait on.
    velocities(), displacements(): arrays; kick(impulse): change every velocity by impulse [kg m/s] over inertia, at once.
    """

    name, kind = "solver", "python"
    components, rotations = 3, 0  # of every node
    nodes = None  # positions (n, 3) [m]
    shape = "particles"  # or "line", "tetrahedron", "hexahedron"
    cells = ()  # nodes of each element; pairs of neighbours of particles
    volumes = ()  # of particles [m3]
    section = 1.0  # of lines [m2]
    critical_step = np.inf  # largest stable step [s]
    accelerations = invariant = save = restore = None  # save() returns an array, restore(array) takes it


class Weight:
    def __init__(self, link, share):
        self.link, self.share = link, share

    def _ask(self, what, x, section=1.0):
        if np.ndim(x) < 2 or np.shape(x)[-1] != 3:
            raise ValueError(f"places of weights have the shape {np.shape(x)}: give coordinates, nodes or nodes[cells]")
        if self.link is None:
            return np.ones(len(x))
        self.link.send(ASK, struct.pack("<BBHId", self.share, what, 0, len(x), section), np.asarray(x, float))
        return np.frombuffer(self.link.receive(SHARES)[1], "<f8")

    def at(self, points):
        """Values at points (n, 3)."""
        return self._ask(0, points)

    def mean(self, cells, section=1.0):
        """Means over lines (n, 2, 3), tetrahedra (n, 4, 3) or hexahedra with plane faces (n, 8, 3): nodes[cells]."""
        return self._ask({2: 1, 4: 2, 8: 3}[np.shape(cells)[1]], cells, section)


class Weights:
    def __init__(self, link=None, nodal=False):
        self.nodal = nodal  # whether values at nodes are wanted in place of means over elements
        self.internal, self.kinetic, self.external = (Weight(link, k) for k in range(3))


class Link:
    def __init__(self, address, patience=5.0):
        scheme, _, rest = address.partition(":")
        if scheme not in ("unix", "tcp", "tcp-open"):
            raise ValueError(f"{address!r} is no address: give unix:PATH or tcp:IP:PORT, or let ARLEQUIN_LINK say it")
        host, _, port = rest.rpartition(":")
        self.socket = socket.socket(socket.AF_UNIX if scheme == "unix" else socket.AF_INET)
        until, failed = time.monotonic() + patience, True
        while failed:
            failed = self.socket.connect_ex(rest if scheme == "unix" else (host, int(port)))
            if failed and time.monotonic() > until:
                raise OSError(failed, os.strerror(failed))
            time.sleep(0.02 if failed else 0)
        if scheme != "unix":
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.file = self.socket.makefile("rb")

    def send(self, kind, *parts):
        body = b"".join(np.ascontiguousarray(p, "<f8").tobytes() if isinstance(p, np.ndarray) else p for p in parts)
        self.socket.sendall(struct.pack("<4sHHQ", b"ARLQ", VERSION, kind, len(body)) + body)

    def working(self):
        self.send(WORKING)

    def _read(self, count):
        data = bytearray(count)
        if self.file.readinto(data) < count:
            raise ConnectionError("the run is gone")
        return data

    def receive(self, *due):
        magic, version, kind, length = struct.unpack("<4sHHQ", self._read(16))
        if magic != b"ARLQ" or version != VERSION or length > LIMIT or (due and kind not in due):
            self.send(FAILED, text(f"this side speaks version {VERSION} and cannot take message {kind} of {version}"))
            raise ConnectionError(f"message {kind} of version {version}, {length} bytes, where {due} was due")
        return kind, self._read(length)


def text(words):
    return struct.pack("<I", len(cut := words.encode(errors="replace")[:1024].decode(errors="ignore").encode())) + cut


def describe(s, link):
    nodes, cells = np.asarray(s.nodes, float), np.asarray(s.cells, "<u4").reshape(-1, CORNERS[s.shape])
    offers = V | Q | (s.accelerations and A or 0) | (s.invariant and INVARIANT or 0) | (s.save and MEMORY or 0)
    sizes, inertia = (list(CORNERS).index(s.shape), 0, len(nodes), len(cells)), np.asarray(s.weigh(Weights()), float)
    head = struct.pack("<QIBBBBQQdd", LIMIT, offers, s.components, s.rotations, *sizes, s.section, s.critical_step)
    link.send(DESCRIPTION, head, text(s.name), text(s.kind), nodes, inertia, np.asarray(s.volumes, float), cells.tobytes())


def answer(s, link, kind, data):
    if kind == ADVANCE:
        s.advance(*struct.unpack_from("<dd", data))
    if kind in (ADVANCE, TELL):
        (wanted,) = struct.unpack_from("<I", data, 16 if kind == ADVANCE else 0)
        told = [f() for bit, f in ((V, s.velocities), (Q, s.displacements), (A, s.accelerations)) if wanted & bit]
        energy = s.invariant() if wanted & INVARIANT else 0.0
        return STATE, struct.pack("<IId", wanted, 0, energy), *(np.asarray(x, float) for x in told)
    if kind == WEIGH:
        inertia = np.asarray(s.weigh(Weights(link, nodal=data[0] == 1)), float)  # may set the step
        return INERTIA, struct.pack("<d", s.critical_step), inertia
    if kind == SAVE:
        return RECORD, struct.pack("<QQ", len(numbers := np.asarray(s.save(), float)), 0), numbers
    if kind == IMPULSE:
        s.kick(np.frombuffer(data, "<f8"))
    elif kind == RESTORE:
        s.restore(np.frombuffer(data, "<f8", struct.unpack_from("<Q", data)[0], 16))
    return (DONE,)


def serve(solver, address=None, link=None):
    """Does as the run says until it ends; an exception of the solver is told to the run and raised here."""
    link = solver.link = link or Link(address or os.environ.get("ARLEQUIN_LINK", ""))
    kind, _ = link.receive(HELLO)
    try:
        describe(solver, link)
        while kind != END:
            kind, data = link.receive()
            link.send(*answer(solver, link, kind, data))
    except Exception as error:
        if not isinstance(error, ConnectionError):
            link.send(FAILED, text(f"{type(error).__name__}: {error}"))
        raise
