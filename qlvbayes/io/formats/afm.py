"""Read files of atomic force microscopes (JPK) by afmformats: tip depth and force of curves."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import ClassVar

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Channel, Recording, Sight
from qlvbayes.io.formats.namedarrays import damaged, needed

_NANO = 1e9  # nm per m, nN per N


class Afm(AbstractFormat):
    """Curves of an AFM; the depth is -height - force/k, without the bending of the cantilever."""

    name: ClassVar[str] = "afm"
    machine: ClassVar[str] = "JPK (.jpk-force, -map, -qi-data), other AFM as afmformats' .tab"
    marks: ClassVar[str] = "a zip archive with header.properties, or a table that afmformats wrote"
    reads: ClassVar[str] = "time, height (measured, else piezo), force, spring constant; nm and nN"
    reference: ClassVar[str] = "afmformats documentation; JPK Instruments, data format"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for a zip that holds JPK's properties, or for the table that afmformats exports."""
        table = head.startswith(b"# afmformats") and b"# BEGIN METADATA" in head
        jpk = head.startswith(b"PK\x03\x04") and b"header.properties" in head
        return Sight.from_marks(
            {"a zip with header.properties, or afmformats' table": jpk or table}
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each curve."""
        afmformats = needed("afmformats", "afmformats", path)
        logging.getLogger("afmformats").addHandler(logging.NullHandler())
        try:
            curves = afmformats.load_data(path)
            several = len(curves) > 1
            return tuple(
                _test(curve, f"curve {k}" if several else "") for k, curve in enumerate(curves, 1)
            )
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # its own errors are not under Exception
            if "spring constant" in str(error):
                raise InputError(
                    "the file does not say the cantilever's spring constant",
                    file=path,
                    remedy="calibrate it and export the curve again",
                ) from error
            raise damaged(path, error) from error


def _test(curve, name: str) -> Recording:  # type: ignore[no-untyped-def]
    height = "height (measured)" if "height (measured)" in curve else "height (piezo)"
    force = np.asarray(curve["force"], dtype=np.float64)
    stiffness = float(curve.metadata["spring constant"])
    depth = -np.asarray(curve[height], dtype=np.float64) - force / stiffness
    return Recording(
        Channel("time", np.asarray(curve["time"], dtype=np.float64), "s", "time"),
        Channel("displacement", depth * _NANO, "nm", f"-{height} - force/k"),
        Channel("force", force * _NANO, "nN", "force"),
        name=name,
        pressing=True,  # a repelled tip bends away: afmformats' own sign of the force
    )
