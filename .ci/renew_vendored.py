"""Fetch the page's libraries anew by npm, as vendor.json lists them, and renew their hashes.

`python .ci/renew_vendored.py` takes the versions that vendor.json names; change one there first to
move to it. It needs npm and the network; nothing else of struck does. Files stay as they come,
unminified; `tests/explorer/test_vendored.py` compares them with their hashes.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import tarfile
import tempfile
from pathlib import Path

VENDOR = Path(__file__).parents[1] / "src/struck/explorer/static/vendor"
LIST = VENDOR / "vendor.json"


def renew() -> None:
    """Write every vendored file, and vendor.json with their hashes."""
    packages = json.loads(LIST.read_text(encoding="utf-8"))
    for package in packages:
        with tempfile.TemporaryDirectory() as scratch:
            name = f"{package['name']}@{package['version']}"
            command = ["npm", "pack", "--silent", "--pack-destination", scratch, name]
            subprocess.run(command, check=True, cwd=scratch)
            with tarfile.open(next(Path(scratch).glob("*.tgz"))) as archive:
                for file in package["files"]:
                    member = archive.extractfile(f"package/{file['from']}")
                    if member is None:
                        raise FileNotFoundError(file["from"])
                    content = member.read()
                    place = VENDOR / file["path"]
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.write_bytes(content)
                    file["sha256"] = hashlib.sha256(content).hexdigest()
    LIST.write_text(json.dumps(packages, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    renew()
