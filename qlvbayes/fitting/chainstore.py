"""A chain on disk, in blocks, so that a killed run goes on where it was."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qlvbayes.io.files import write_whole


@dataclass(frozen=True)
class Stretch:
    """Consecutive steps: theta (S, W, D), log density (S, W), and the generator's state after."""

    theta: np.ndarray
    log_density: np.ndarray
    accepted: int
    random_state: tuple


class ChainStore:
    """Stretches as numbered files in one folder; ``key`` ties them to one posterior and seed."""

    def __init__(self, folder: Path, key: str) -> None:
        self.folder = folder
        self.key = key

    def load(self) -> Iterator[Stretch]:
        """The stretches written before, in order, as far as they belong to this run.

        One that cannot be read ends them: it and what came after are sampled again.
        """
        for number in range(10**6):
            try:
                stretch = self._read(self._path(number))
            except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
                return
            if stretch is None:
                return
            yield stretch

    def _read(self, path: Path) -> Stretch | None:
        """One stretch; None if it is another run's."""
        with np.load(io.BytesIO(path.read_bytes())) as file:
            if str(file["key"]) != self.key:
                return None
            place, half, normal = file["place"]
            state = ("MT19937", file["state"], int(place), int(half), float(normal))
            return Stretch(file["theta"], file["log_density"], int(file["accepted"]), state)

    def save(self, number: int, stretch: Stretch) -> None:
        """Write stretch ``number``, whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        _, state, *place = stretch.random_state
        content = io.BytesIO()
        np.savez(
            content,
            key=self.key,
            theta=stretch.theta,
            log_density=stretch.log_density,
            accepted=stretch.accepted,
            state=state,
            place=np.array(place, dtype=float),
        )
        write_whole(self._path(number), content.getbuffer())

    def _path(self, number: int) -> Path:
        return self.folder / f"stretch-{number:05d}.npz"


def remove_chain(folder: Path) -> None:
    """Remove a chain's folder, once the results are written."""
    if folder.is_dir():
        for path in folder.glob("stretch-*"):
            path.unlink()
        folder.rmdir()
