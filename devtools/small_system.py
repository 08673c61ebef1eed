"""A small Debian system in a folder of this clone (debootstrap and chroot), for programs of another suite.

Nothing of the machine's own system is changed.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from .places import Failure, run_quietly, say
from .system_libraries import apt_install, can_apt

INSIDE = {
    "HOME": "/root",  # of the small system, not of this machine
    "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
    "LANG": "C.UTF-8",
    "DEBIAN_FRONTEND": "noninteractive",
}


@dataclass(frozen=True)
class SmallSystem:
    """``what``: it is for, in messages; ``size``: on disk, for people."""

    suite: str
    folder: Path
    packages: tuple[str, ...]
    what: str
    size: str

    @property
    def stamp(self) -> Path:
        """The file that is there once all packages are installed."""
        return self.folder / "ready"

    def command(self, *words: str) -> tuple[str, ...]:
        """A command of this machine that runs words inside."""
        return ("chroot", str(self.folder), *words)

    def set_up(self) -> None:
        """Make the system, if it is not there with these packages; root on Debian only."""
        ready = f"{self.suite}: {' '.join(self.packages)}\n"
        if self.stamp.is_file() and self.stamp.read_text() == ready:
            return
        if not can_apt():
            raise Failure(f"{self.what} needs root and apt-get to be set up here")
        if shutil.which("debootstrap") is None:
            apt_install(["debootstrap"])
        say(f"Setting up {self.what} in {self.folder.name} ({self.size})")
        if (self.folder / "debootstrap").exists() or not (self.folder / "usr/bin/apt-get").exists():
            shutil.rmtree(self.folder, ignore_errors=True)  # half made: debootstrap cannot take it up again
            self.folder.mkdir(parents=True)
            bootstrap = ["debootstrap", "--variant=minbase", self.suite, self.folder]
            run_quietly(bootstrap, "debootstrap could not make the small system.")
        settings = self.folder / "etc"
        (settings / "apt/apt.conf.d/99novaliduntil").write_text('Acquire::Check-Valid-Until "false";\n')
        (settings / "dpkg/dpkg.cfg.d/01nodoc").write_text(
            "".join(f"path-exclude /usr/share/{name}/*\n" for name in ("doc", "man", "locale"))
        )
        for words, sentence in (
            (("apt-get", "update"), "The package lists of the small system could not be fetched."),
            (
                ("apt-get", "install", "-y", "--no-install-recommends", *self.packages),
                f"{self.what} could not be installed.",
            ),
            (("apt-get", "clean"), "apt-get clean failed in the small system."),
        ):
            run_quietly(self.command(*words), sentence, env=INSIDE)
        self.stamp.write_text(ready)
