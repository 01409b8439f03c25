"""The times at which a test's motion is tabulated, with negligible error in between."""

from __future__ import annotations

import numpy as np

from qlvbayes.motion.trajectory import Trajectory

_CHORD = 1e-4  # of the stroke: how far the grid's straight lines may be from the motion,
_FINEST = 3e-6  # and the least that very quiet noise asks for
_CURVED = 10.0  # times that, where the curvature between the points is stored too: on a sine half
# as many points, and a tenth of the error of the force that straight lines make (2e-6 of its peak)


def grid_times(
    trajectory: Trajectory,
    nodes: np.ndarray,
    first: float,
    *,
    chord: float = np.inf,
    begun: bool = True,
    curved: bool = True,
) -> np.ndarray:
    """Return the nodes, the beginning, the kinks, and as many points between as accuracy needs."""
    stroke = np.ptp(trajectory.displacement(trajectory.knots))
    tolerance = max(0.25 * trajectory.resolution, _CHORD * stroke)
    tolerance = min(tolerance, max(chord, _FINEST * stroke)) * (_CURVED if curved else 1.0)
    inner = trajectory.knots[(trajectory.knots > first) & (trajectory.knots < nodes[-1])]
    approach = _approach(trajectory, first) if begun else np.zeros(0)
    points = np.unique(np.concatenate([approach, [first], inner, nodes]))
    width = np.diff(points)
    bend = np.abs(trajectory.acceleration(0.5 * (points[1:] + points[:-1])))
    pieces = np.ceil(width * np.sqrt(bend / (8.0 * tolerance))).astype(int)
    extra = [
        np.linspace(points[k], points[k + 1], pieces[k] + 1)[1:-1]
        for k in np.flatnonzero(pieces > 1)
    ]
    return np.unique(np.concatenate([points, *extra]))


def path_at(trajectory: Trajectory, grid: np.ndarray, first: float) -> np.ndarray:
    """Return the displacement on the grid; the approach before the first sample begins at zero."""
    return np.where(grid < first, 0.0, trajectory.displacement(grid))


def _approach(trajectory: Trajectory, first: float) -> np.ndarray:
    """Return when a record that begins in motion was last at zero displacement."""
    depth = float(trajectory.displacement(np.array([first]))[0])
    speed = float(trajectory.velocity(np.array([first]))[0])
    return np.array([first - depth / speed]) if depth * speed > 0.0 else np.zeros(0)
