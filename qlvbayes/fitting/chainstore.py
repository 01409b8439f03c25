"""Store a chain on disk in segments, so that an interrupted run can resume."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qlvbayes.io.files import write_whole


@dataclass(frozen=True)
class ChainSegment:
    """Consecutive steps of a chain, with the state of the random generator after them."""

    # theta (S, W, D) and log_density (S, W): of S steps of W walkers
    theta: np.ndarray
    log_density: np.ndarray
    accepted: int  # number of accepted moves
    random_state: tuple


class ChainStore:
    """The segments of a chain as numbered files in one folder.

    key: identifies the posterior and the seed that the chain belongs to.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder = folder
        self.key = key

    def load(self) -> Iterator[ChainSegment]:
        """Yield the stored segments in order, as far as they belong to this run."""
        for number in range(10**6):
            try:
                segment = self._read(self._path(number))
            except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
                return
            if segment is None:
                return
            yield segment

    def _read(self, path: Path) -> ChainSegment | None:
        """Return one segment; None if it belongs to another run."""
        with np.load(io.BytesIO(path.read_bytes())) as file:
            if str(file["key"]) != self.key:
                return None
            position, half, normal = file["place"]
            state = ("MT19937", file["state"], int(position), int(half), float(normal))
            return ChainSegment(file["theta"], file["log_density"], int(file["accepted"]), state)

    def save(self, number: int, segment: ChainSegment) -> None:
        """Write segment ``number``, completely or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        _, state, *position = segment.random_state
        content = io.BytesIO()
        np.savez(
            content,
            key=self.key,
            theta=segment.theta,
            log_density=segment.log_density,
            accepted=segment.accepted,
            state=state,
            place=np.array(position, dtype=float),
        )
        write_whole(self._path(number), content.getbuffer())

    def _path(self, number: int) -> Path:
        """Return the path of a segment."""
        return self.folder / f"stretch-{number:05d}.npz"


def remove_chain(folder: Path) -> None:
    """Remove a chain's folder; called once the results are written."""
    if folder.is_dir():
        for path in folder.glob("stretch-*"):
            path.unlink()
        folder.rmdir()
