"""Modules import only from the layers above their own."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import qlvbayes
from qlvbayes.pipeline.derived import CompareStep
from qlvbayes.pipeline.run import FinalStep
from qlvbayes.pipeline.steps import CheckStep, DiagnoseStep, FitStep

ROOT = Path(qlvbayes.__file__).parent
TESTS = Path(__file__).parents[1]

# One row a layer, the lowest first; each folder with what it is for.
HOUSE = [
    {"xp": "functions of arrays of NumPy or JAX", "pytree": "classes of arrays"},
    {"io": "files and what users read of them", "priors": "densities of constants"},
    {
        "parallel": "one task for many pads: here, in processes, on a cluster",
        "laws": "what a material does: elastic laws, relaxations, the hereditary integral",
        "simulate": "a rig of its own, which shares nothing with the model",
    },
    {
        "effects": "what may be missing, effects of one kind a file",
        "motion": "from readings to records: motion, phases, noise floor, blocks",
    },
    {"model": "a specimen with its noise: force, priors, and a user's choices"},
    {"inference": "the evidence of hypotheses: density, modes, sampling"},
    {"fitting": "constants from tests: emcee, predictions, where they fail, results"},
    {
        "diagnosis": "which effect is missing, and which test would tell",
        "comparison": "two pads, two fluids",
    },
    {
        "use": "constants put to use: programmes, stepper, exports",
        "guess": "a first guess of what is missing, learnt from simulated pads",
    },
    {"evaluation": "how often each effect would be named in a user's tests"},
    {"plots": "figures for papers, one function a file, and their list"},
    {"report": "the page with all results"},
    {"pipeline": "the steps of a study with the files they leave"},
    {"app": "the bench in the browser"},
    {"cli": "the command"},
]
LAYERS = [list(row) for row in HOUSE]
FRONTS = ("__init__.py", "__main__.py")
FRONT = "qlvbayes"  # the package's own names, gathered from all layers
PLACE = {entry: row for row, entries in enumerate(LAYERS) for entry in entries}


def entry_of(module):
    """Part of the package that a dotted module name belongs to."""
    return module[1] if len(module) > 1 else FRONT


@cache
def tree(path):
    return ast.parse(path.read_text())


def imports(path):
    """(importer, imported) entries of one file, wherever in it the import stands."""
    module = ("qlvbayes", *path.relative_to(ROOT).with_suffix("").parts)
    package = module[:-1]
    if path.name in FRONTS:
        module = package
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found = [tuple(alias.name.split(".")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            base += tuple(node.module.split(".")) if node.module else ()
            found = [(*base, alias.name) for alias in node.names]
        else:
            continue
        for name in found:
            inside = name[0] == "qlvbayes" and name[1:] not in ((), ("__version__",))
            if inside and entry_of(name) != entry_of(module):
                yield entry_of(module), entry_of(name)


FILES = sorted(ROOT.rglob("*.py"))


@cache
def every_import():
    return sorted({pair for path in FILES for pair in imports(path)})


def test_every_module_is_in_exactly_one_layer_and_its_tests_in_a_folder_of_its_name():
    entries = [entry for row in LAYERS for entry in row]
    assert len(entries) == len(set(entries))
    present = {path.relative_to(ROOT).parts[0].removesuffix(".py") for path in FILES}
    assert present - {Path(name).stem for name in FRONTS} == set(entries)
    folders = {path.parent.name for path in TESTS.rglob("test_*.py")}
    assert folders - {"project", "validation"} == set(PLACE) - {"xp", "pytree"}


def test_imports_point_upward_only_and_the_simulator_shares_nothing():
    wrong = [
        f"{importer} imports {imported}"
        for importer, imported in every_import()
        if importer != FRONT and PLACE[imported] >= PLACE[importer]
    ]
    assert not wrong
    assert {imported for importer, imported in every_import() if importer == "simulate"} <= {"io"}


def test_files_motion_and_simulator_need_no_jax():
    """They are plain numpy, quick to import and to run."""
    plain = [
        *ROOT.glob("io/**/*.py"),
        *ROOT.glob("simulate/**/*.py"),
        *ROOT.glob("motion/noisefloor/*.py"),
        *(ROOT / "motion" / f"{name}.py" for name in ("trajectory", "phases", "stretch")),
    ]
    assert len(plain) > 40
    for path in plain:
        names = [
            getattr(node, "module", None) or alias.name
            for node in ast.walk(tree(path))
            if isinstance(node, (ast.Import, ast.ImportFrom))
            for alias in node.names
        ]
        jax = [name for name in names if name.split(".")[0] in ("jax", "equinox")]
        assert not jax or path.name == "runtime.py", path


def test_no_module_imports_itself_in_a_circle():
    graph = {}
    for path in FILES:
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        found = set()
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qlvbayes."):
                base = node.module.removeprefix("qlvbayes.")
                found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
        graph[module] = found
    known = {name: {x for x in found if x in graph} - {name} for name, found in graph.items()}
    TopologicalSorter(known).prepare()


def test_a_step_is_done_again_after_a_change_of_what_it_computes_with_and_of_nothing_else():
    for step, folder in (
        (FitStep, "fitting"),
        (CheckStep, "fitting"),
        (DiagnoseStep, "diagnosis"),
        (DiagnoseStep, "use"),
        (FinalStep, "diagnosis"),
        (CompareStep, "comparison"),
    ):
        needed, new = {folder}, {folder}
        while new:
            new = {imported for importer, imported in every_import() if importer in new} - needed
            needed |= new
        alone = {path.stem for path in ROOT.glob("*.py")}  # count for every step
        assert needed - alone <= set(step.code), step
        assert not {"plots", "report", "pipeline", "app", "cli"} & set(step.code)
