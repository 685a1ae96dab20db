"""Build hook: compile the core's C files for the platform that a wheel or an installation is of."""

from __future__ import annotations

import os
import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags

# Tags of wheels that need nothing of Python's own interface: any version of it will do.
TAGS = {
    "linux-x86_64": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "linux-aarch64": "manylinux_2_17_aarch64.manylinux2014_aarch64",
    "macos-x86_64": "macosx_12_0_x86_64",
    "macos-arm64": "macosx_12_0_arm64",
    "windows-x86_64": "win_amd64",
}


class CoreHook(BuildHookInterface[Any]):
    """The core in a wheel, or beside its sources where an installation is editable."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile for ``STRUCK_PLATFORM``, or for this machine; an unknown one gets no core."""
        core = runpy.run_path(str(Path(self.root) / "src/struck/core/build.py"))
        asked = os.environ.get("STRUCK_PLATFORM")
        if asked and asked not in TAGS:
            raise ValueError(f"STRUCK_PLATFORM is {asked!r}: give one of {', '.join(TAGS)}")
        name = asked or core["this_platform"]()
        if name not in TAGS:
            self.app.display_warning(f"struck has no compiled core for {name}: it will be slow")
            return
        # What is built here runs here, whatever the system calls itself.
        tag = TAGS[name] if asked else next(sys_tags()).platform
        build_data["pure_python"], build_data["tag"] = False, f"py3-none-{tag}"
        self._scratch = tempfile.TemporaryDirectory()
        folder = [] if version == "editable" else [Path(self._scratch.name)]
        for library in (*core["build"](name, *folder), *core["build"](core["PAGES"], *folder)):
            if folder:
                build_data["force_include"][str(library)] = f"struck/core/libraries/{library.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what the wheel has taken in."""
        del version, build_data, artifact_path
        if hasattr(self, "_scratch"):
            self._scratch.cleanup()
