"""``qlvbayes benchmark``: how often each effect would be named, in tests like the user's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from qlvbayes.cli.console import counting, out, table
from qlvbayes.cli.options import WorkOptions, split_names
from qlvbayes.cli.settings import share_of
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.files import results_folder, write_json

if TYPE_CHECKING:
    from qlvbayes.evaluation.session import RigSession
    from qlvbayes.evaluation.table import EffectRow


def benchmark(
    file: Path | None = None,
    pad: str = "",
    programme: list[str] | None = None,
    noise: str = "correlated",
    bonded: bool = False,
    effects: str = "",
    size: str = "6%",
    each: int = 5,
    seed: int = 0,
    output: Path = Path("benchmark"),
    *,
    work: WorkOptions,
    as_json: bool = False,
) -> None:
    """Say how often each effect would be named, with your pad, your noise and your tests.

    Simulates pads that each hide one effect, and some that hide none, and diagnoses them. A pad
    takes about as long as the diagnosis of FILE. Finished pads are kept; the same command goes on
    where it stopped, and more --each or --effects add to it.

    Leaves OUT/benchmark.json. Of parts (--shard) the pads are kept; the same command without it
    then counts all of them.

    Options:
    file FILE: Measurements, whose pad, noise and tests are simulated. Default: pad B of the paper,
        correlated noise, the paper's tests.
    pad --pads --pad --specimen: The pad of FILE, by default the only one; without FILE a pad of
        'simulate --pads', by default B.
    programme: A test in words, as 'ramp 1.6 mm at 20 mm/s, hold 30 s', in place of those of FILE;
        repeatable.
    noise --load-cell --noise: Without FILE: a noise of 'simulate --load-cell'.
    bonded --bonded/--loose: Whether the pad is fixed and can pull.
    effects: Hide only these, as 'friction,inertia'. Default: all.
    size: Largest force of the effect over the pad's, as '6%' or '0.06'.
    each 1..: Pads simulated for each effect, and for nothing.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.evaluation.store import Store, run_missing, store_path
    from qlvbayes.evaluation.study import NOTHING, Benchmark, effects_of, index_of
    from qlvbayes.evaluation.table import rows

    share = share_of(size)
    if not 0.0 < share < 1.0:
        raise InputError(f"a size of {size}", remedy="give a share of the peak force, as 6%")
    hidden = (NOTHING, *effects_of(tuple(split_names(effects)), bonded=bonded))
    session = _session(file, pad, noise, bonded=bonded)
    simulated = Benchmark(session.with_programmes(programme) if programme else session, share, seed)
    studies = [(name, number) for number in range(each) for name in hidden]
    shard = work.part
    part = shard.index if shard.count > 1 else None
    folder = results_folder(output)
    store = Store(store_path(folder / "studies", simulated.key), simulated.key, part)
    indices = shard.part(studies)
    with work.engine() as engine, counting("pads") as report:
        run_missing(simulated.run, store, indices, report, engine, key=index_of)
    if part is not None:
        out.print(f"{len(indices)} pads in {folder}; the same command without --shard counts all")
        return
    cases = [store.cases[index_of(study)] for study in studies]
    found = rows(cases, hidden)
    content = {
        "schema": 2, "seed": seed, "size": share, "tests": list(simulated.session.names),
        "effects": [row.as_dict() for row in found], "cases": cases,
    }  # fmt: skip
    write_json(folder / "benchmark.json", content)
    if as_json:
        print(json.dumps(content, allow_nan=False))
    else:
        out.print(effects_table(found, share))


def _session(file: Path | None, name: str, noise: str, *, bonded: bool) -> RigSession:
    from qlvbayes.evaluation.session import RigSession
    from qlvbayes.io.data import read_measurements
    from qlvbayes.simulate import NOISES, SPECIMENS

    if file is None:
        check_known("pad", specimen := name or "B", SPECIMENS)
        check_known("noise", noise, NOISES)
        return RigSession.of_the_paper(SPECIMENS[specimen], NOISES[noise], bonded=bonded)
    study = read_measurements(file)
    known = [one.name for one in study.pads]
    if not name and len(known) > 1:
        raise InputError(f"several pads: {', '.join(known)}", file=file, remedy="name one by --pad")
    return RigSession.of_pad(study.pad(name or known[0]), bonded=bonded)


def effects_table(found: list[EffectRow], size: float) -> Table:
    """Return one row an effect, with the bounds of the share in which the verdict is right."""
    title = f"pads that hide one effect of {100 * size:g} % of the peak force, or nothing"
    counted = (">in a group", ">another named", ">none named", ">failed")
    made = table(title, "hidden", ">size", ">pads", ">named", ">95 % bounds", *counted)
    for row in found:
        low, high = (f"{100 * x:.0f}" for x in row.bounds)
        counts = (str(x) if x else "" for x in (row.grouped, row.wrong, row.silent, row.failed))
        share, named = f"{100 * row.share:.1f} %", (str(row.pads), str(row.named))
        made.add_row(row.effect, share, *named, f"{low} to {high} %", *counts)
    return made
