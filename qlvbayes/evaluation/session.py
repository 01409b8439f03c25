"""A user's pad, noise and tests, as the simulator takes them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from qlvbayes.fitting.optimum import best_model
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Control, Pad
from qlvbayes.io.units import PAD
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.motion.trajectory import Trajectory
from qlvbayes.simulate import (
    ENCODER_STEP,
    PAPER_ACCELERATION,
    PAPER_RATES,
    SAMPLE_RATE,
    Constants,
    Noise,
    Platen,
    encode,
    paper_protocol,
    thin,
)
from qlvbayes.simulate.motion import Motion, Piece, Track
from qlvbayes.use.prescribed.program import parse

_PAUSE_S = 120.0  # between tests that no file has
_ROWS = 500  # of such a test
_PARTS = 12  # of a smooth stretch of a motion, each of constant acceleration
_REST_S = 0.05  # before a programme begins
_SAME = 1e-9  # of the top speed: less is no corner


@dataclass(frozen=True)
class ForceErrors:
    """Errors of the force: noise that may grow with it, then rounding.

    noise: at a force of ``level`` (N); growth: of its sd, 1/N; step: of the digitised force, N.
    """

    noise: Noise
    growth: float = 0.0
    level: float = 0.0
    step: float = 0.0

    def read(self, time: Array, force: Array, rng: np.random.Generator) -> Array:
        """Return the reading (N) of a true force."""
        size = (1.0 + self.growth * np.abs(force)) / (1.0 + self.growth * self.level)
        noisy = force + size * self.noise.draw(time, rng)
        return np.round(noisy / self.step) * self.step if self.step else noisy


@dataclass(frozen=True, eq=False)
class RigSession:
    """One pad's constants, its tests and the errors of its readings, in mm, N and s.

    names, motions, times: of every test, with the times of its readings; encoder: its step, 0 for
    none; bonded: whether the pad can pull.
    """

    constants: Constants
    errors: ForceErrors
    names: tuple[str, ...]
    motions: tuple[Motion, ...]
    times: tuple[Array, ...]
    encoder: float = ENCODER_STEP
    bonded: bool = False

    @property
    def key(self) -> str:
        """Digest of all that the readings depend on."""
        digest = hashlib.sha256(repr((self.constants, self.errors, self.names)).encode())
        digest.update(repr((self.encoder, self.bonded)).encode())
        for motion, times in zip(self.motions, self.times, strict=True):
            pieces = [astuple(piece) for piece in motion.pieces]
            digest.update(np.array([[motion.start_s, 0.0, 0.0, 0.0, 0.0], *pieces]).tobytes())
            digest.update(times.tobytes())
        return digest.hexdigest()[:12]

    @classmethod
    def of_pad(cls, pad: Pad, *, bonded: bool = False) -> RigSession:
        """Return the tests of a measured pad, with its noise and the paper's law fitted."""
        if pad.units.dimensionless:
            raise InputError(
                f"pad {pad.name} has strain and stress; the simulator has displacement and force",
                remedy="give a file in mm and N",
            )
        experiment = prepare(pad)
        mm, newton = (pad.units.factor_to(PAD, kind) for kind in ("displacement", "force"))
        motions, times = [], []
        for number, trial in enumerate(experiment.trials):
            if trial.control != Control.DISPLACEMENT:
                raise InputError(
                    f"in test {trial.name} of pad {pad.name} a force was prescribed",
                    remedy="leave the test out of the file, or give --programme",
                )
            path, clock = trial.trajectory, trial.test.start_s - experiment.clock_zero
            motions.append(Track(_pieces(path, mm), clock + float(path.knots[0]), number))
            inside = trial.test.time - path.knots[0]
            times.append(np.clip(inside, 0.0, motions[-1].duration))
        floor = experiment.floor
        white = float(np.sqrt(max(floor.white**2 - floor.step**2 / 12.0, 0.0)))
        return cls(
            _fitted(experiment, bonded, mm, newton),
            ForceErrors(
                Noise(newton * white, newton * floor.ou, floor.tau),
                floor.growth / newton,
                newton * floor.level,
                newton * floor.step,
            ),
            tuple(trial.name for trial in experiment.trials),
            tuple(motions),
            tuple(times),
            mm * max(trial.trajectory.resolution for trial in experiment.trials),
            bonded,
        )

    @classmethod
    def of_the_paper(
        cls, constants: Constants, noise: Noise, *, bonded: bool = False
    ) -> RigSession:
        """Return the paper's tests of a pad."""
        programs = [paper_protocol(rate) for rate in PAPER_RATES]
        motions = [Platen(program, number=number) for number, program in enumerate(programs)]
        names = [f"{rate:g} mm/s" for rate in PAPER_RATES]
        empty = cls(constants, ForceErrors(noise), (), (), (), bonded=bonded)
        return empty._with(names, motions)

    def with_programmes(self, texts: Sequence[str]) -> RigSession:
        """Return the same pad and errors with other tests, each a programme in words."""
        motions = [_of_programme(text, number) for number, text in enumerate(texts)]
        return self._with([f"programme {k + 1}" for k in range(len(texts))], motions)

    def _with(self, names: Sequence[str], motions: Sequence[Platen | Track]) -> RigSession:
        """Return the session with tests one after another, read as a thinning logger does."""
        clock, begun, times = 0.0, [], []
        for motion in motions:
            begun.append(replace(motion, start_s=clock))
            clock += motion.duration + _PAUSE_S
            every = np.arange(int(motion.duration * SAMPLE_RATE + 1e-6) + 1) / SAMPLE_RATE
            seen = encode(motion.displacement(every), self.encoder or ENCODER_STEP)
            times.append(every[thin(every, seen, _ROWS)])
        return replace(self, names=tuple(names), motions=tuple(begun), times=tuple(times))


def _fitted(experiment: Experiment, bonded: bool, mm: float, newton: float) -> Constants:
    """Return the constants of the paper's law closest to all tests, in mm and N."""
    choices = Choices(rested=True, bonded=bonded)
    model = best_model(experiment, choices, experiment.trials)
    elastic, relaxation = model.elastic, model.relaxation
    assert isinstance(elastic, Exponential)  # the laws of the paper, which `Choices` begin with
    assert isinstance(relaxation, Prony)
    c, v = (np.asarray(x, dtype=float) for x in (relaxation.c, relaxation.v))
    return Constants(
        newton / mm * float(elastic.m),
        float(elastic.b) / mm,
        tuple((c / c.sum()).tolist()),
        tuple(v.tolist()),
    )


def _pieces(path: Trajectory, mm: float) -> tuple[Piece, ...]:
    """Return a measured motion in pieces of constant acceleration, from its first knot on."""
    parts = 1 if path.higher is None else _PARTS
    edges = path.knots[0] + np.zeros(1)
    for start, stop in zip(path.knots[:-1], path.knots[1:], strict=True):
        edges = np.append(edges, np.linspace(start, stop, parts + 1)[1:])
    speed = path.path.derivative()
    pieces, position = [], mm * float(path.path(path.knots[0]))
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        inner = start + np.array([0.25, 0.75]) * (stop - start)  # speeds may jump at the edges
        slow, fast = (mm * speed(inner)).tolist()
        acceleration = (fast - slow) / (0.5 * (stop - start))
        velocity = slow - 0.25 * (stop - start) * acceleration
        begin = start - float(path.knots[0])
        pieces.append(Piece(begin, stop - start, position, velocity, acceleration))
        position = pieces[-1].end
    return tuple(pieces)


def _of_programme(text: str, number: int) -> Track:
    """Return the motion of a programme, whose corners a platen rounds by its acceleration."""
    programme = parse(text, PAD)
    if programme.quantity != "displacement":
        raise InputError(f"'{text}' prescribes a force", remedy="write displacements, as 1.6 mm")
    time = np.append(-_REST_S, programme.time) + _REST_S
    depth = np.append(0.0, programme.value)
    moved = np.append(np.diff(time) > 0.0, True)
    time, depth = time[moved], depth[moved]
    speed = np.diff(depth) / np.diff(time)
    corner = np.abs(np.diff(speed)) > _SAME * np.abs(speed).max()
    kept = np.concatenate([[True], corner, [True]])
    time, depth = time[kept], depth[kept]
    speed = np.diff(depth) / np.diff(time)
    rounding = np.abs(np.diff(speed)) / PAPER_ACCELERATION
    most = np.minimum(np.diff(time)[:-1], np.diff(time)[1:])
    half = 0.5 * np.concatenate([[0.0], np.minimum(rounding, most), [0.0]])
    pieces, clock, position = [], 0.0, 0.0
    for k, velocity in enumerate(speed.tolist()):
        straight = float(time[k + 1] - half[k + 1]) - clock
        turn = 2.0 * float(half[k + 1])
        lines = [(straight, 0.0)] if straight > 0.0 else []
        lines += [(turn, (float(speed[k + 1]) - velocity) / turn)] if turn > 0.0 else []
        for duration, acceleration in lines:
            pieces.append(Piece(clock, duration, position, velocity, acceleration))
            clock, position = clock + duration, pieces[-1].end
    return Track(tuple(pieces), number=number)
