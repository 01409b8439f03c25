"""Puts ``data/`` into the wheel as ``qlvbayes/data``; all else is in pyproject.toml."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithData(build_py):
    """An editable installation reads the repository's own folder, and gets no copy."""

    def run(self) -> None:
        """Build the package, then copy the measurements."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib, "qlvbayes", "data")
            self.mkpath(str(target))
            for file in sorted(Path("data").iterdir()):
                self.copy_file(str(file), str(target / file.name))


setup(cmdclass={"build_py": BuildWithData})
