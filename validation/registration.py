"""The registration of a run before it: seed, studies, strata, required rates, code digests."""

from __future__ import annotations

import hashlib
import json
import subprocess
from dataclasses import asdict, dataclass
from pathlib import Path

from blind import counting
from blind.lists import FIRST, PRESENT, Lists
from blind.population import Population
from blind.store import code_digest

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path(__file__).parent / "registered"

ASKED: dict[str, dict[str, float]] = {
    "wide": {
        "none_adequate": 0.95, "false_name": 0.02, "single_named": 0.85, "single_group": 0.95,
        "double_named": 0.70, "form_kin": 0.80, "outside_open": 0.90, "beside_named": 0.70,
        "wrong": 0.02, "failed": 0.0,
    },
    "paper": {
        "none_adequate": 0.95, "false_name": 0.02, "single_named": 0.95, "single_group": 0.95,
        "double_named": 0.85, "form_kin": 0.90, "outside_open": 0.90, "beside_named": 0.60,
        "wrong": 0.05, "failed": 0.0, "right": 0.75,
    },
}  # fmt: skip
"""Shares asked of each rate, by rig: at least, or for what is bad at most."""


@dataclass(frozen=True)
class Registration:
    """A registered run.

    code: digest of all code that a study's outcome may depend on; tree: git's hash of the package's
    folder; rules: of the file with the rules of the count; disturbed: whether the population has
    disturbed records, as those of new registrations have; lists: the names of what may be hidden,
    so that effects which are added later do not change the run; paper: whether the pads and tests
    are those of the paper's rig; kinds: what the studies that are run hide, None for all.
    """

    name: str
    seed: int
    studies: int
    code: str
    tree: str
    rules: str
    strata: dict[str, list[str]]
    asked: dict[str, float]
    note: str = ""
    disturbed: bool = False
    lists: dict[str, list[str]] | None = None
    paper: bool = False
    kinds: list[str] | None = None

    @property
    def population(self) -> Population:
        """The registered population."""
        lists = FIRST if self.lists is None else Lists(**_tuples(self.lists))
        effects, disturbed = lists.listed, self.disturbed
        return Population(self.seed, self.paper, effects=effects, disturbed=disturbed, lists=lists)

    @property
    def indices(self) -> list[int]:
        """The studies that are run."""
        item, kinds = self.population.item, self.kinds
        every = range(self.studies)
        return [k for k in every if kinds is None or item(k).levels["kind"] in kinds]

    @classmethod
    def of_present(
        cls,
        name: str,
        seed: int,
        studies: int,
        note: str = "",
        paper: bool = False,
        kinds: list[str] | None = None,
    ) -> Registration:
        """Return the registration of a run by the present code."""
        population = Population(seed, paper, disturbed=not paper)
        digests = code_digest(), _tree(), rules_digest()
        lists = {key: list(names) for key, names in asdict(PRESENT).items()}
        about = _strata(population), ASKED["paper" if paper else "wide"], note
        return cls(name, seed, studies, *digests, *about, not paper, lists, paper, kinds)

    @classmethod
    def read(cls, name: str) -> Registration:
        """Read validation/registered/NAME.json."""
        return cls(**json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8")))

    def write(self) -> Path:
        """Write its file; a registration is never overwritten.

        Raises
        ------
        FileExistsError
            There is one of this name.
        """
        FOLDER.mkdir(exist_ok=True)
        path = FOLDER / f"{self.name}.json"
        with path.open("x", encoding="utf-8") as file:
            file.write(json.dumps(asdict(self), indent=2) + "\n")
        return path

    def broken(self, finished: bool = False) -> list[str]:
        """Return what has changed since the registration.

        finished: whether the studies are only counted, which the registered code has run; then only
        the rules of the count must be unchanged.
        """
        pairs = {
            "the code": (self.code, code_digest()),
            "the rules of the count": (self.rules, rules_digest()),
            "the strata": (self.strata, _strata(self.population)),
        }
        if finished:
            del pairs["the code"]
        return [what for what, (then, now) in pairs.items() if then != now]


def _strata(population: Population) -> dict[str, list[str]]:
    return {key: list(levels) for key, levels in population.strata.items()}


def _tuples(lists: dict[str, list[str]]) -> dict[str, tuple[str, ...]]:
    return {key: tuple(names) for key, names in lists.items()}


def rules_digest() -> str:
    """Return the digest of the file with the rules of the count."""
    return hashlib.sha256(Path(str(counting.__file__)).read_bytes()).hexdigest()[:12]


def _tree() -> str:
    command = ("git", "rev-parse", "HEAD:qlvbayes")
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"
