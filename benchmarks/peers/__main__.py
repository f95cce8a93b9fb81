"""``python -m benchmarks.peers [SCENE...]``: measure each scene with its peer, fill the page's table.

Each scene runs in a process of its own, so that a peer that is missing or crashes is one line.
"""

from __future__ import annotations

import dataclasses
import datetime
import importlib
import importlib.metadata
import json
import os
import pkgutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.history import commit, load_words, machine
from benchmarks.peers import scenes
from benchmarks.peers.compare import PeerScene
from benchmarks.table_row import markdown_head
from spacerobot.common.files import write_text

PAGE = Path(__file__).parents[2] / "docs" / "validation" / "peers.md"
BEGIN, END = "<!-- filled by `make peers` -->", "<!-- end -->"
COLUMNS = ("peer", "scene", "agreement", "converged to, ours / theirs", "ours", "theirs", "theirs : ours")
COLUMNS += ("settings", "remarks")
HEAD, RULE = markdown_head(COLUMNS)


def found_scenes() -> dict[str, PeerScene]:
    """Every scene by the name of its file."""
    names = sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))
    return {name: importlib.import_module(f"{scenes.__name__}.{name}").SCENE for name in names}


def measured(scene: PeerScene) -> dict[str, Any]:
    """Outcome of a scene as plain values, or why there is none."""
    try:
        # the package first: parts of one that was removed can still be imported
        version = importlib.metadata.version(scene.package)
        outcome = scene.measure()
    except ImportError as error:
        return {"missing": f"{scene.peer} is not installed (pip install {scene.package}): {error}"}
    return dataclasses.asdict(outcome) | {"version": version}


def in_a_process(name: str) -> dict[str, Any]:
    """The same in a process of its own, with nothing compiled before; a crash is a reason too."""
    with tempfile.TemporaryDirectory() as folder:
        env = {**os.environ, "SPACEROBOT_CACHE_DIR": folder, "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", __spec__.name, "--one", name]
        ended = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    lines = ended.stdout.splitlines()
    if ended.returncode == 0 and lines:
        return dict(json.loads(lines[-1]))
    last = (ended.stderr.strip().splitlines() or ["no message"])[-1]
    return {"missing": f"ended with code {ended.returncode}: {last}"}


def row(scene: PeerScene, results: Mapping[str, Any]) -> str:
    """A line of the table."""
    if "missing" in results:
        cells = [scene.peer, scene.title, "not measured", "", "", "", "", "", results["missing"]]
    else:
        ours, theirs = results["ours_s"], results["theirs_s"]
        cells = [f"{scene.peer} {results['version']}", scene.title, results["agreement"], results["error"]]
        cells += [time(ours), time(theirs), f"{theirs / ours:.3g}"]
        cells += [f"ours: {results['ours']}; theirs: {results['theirs']}", scene.note]
    return f"| {' | '.join(cells)} |"


def time(seconds: float) -> str:
    """A time in a unit that suits it."""
    return f"{seconds:.3g} s" if seconds >= 1 else f"{seconds * 1e3:.3g} ms"


def filled(page: str, lines: list[str]) -> str:
    """The page with its table replaced."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n{END}{rest.split(END)[1]}"


def main() -> None:
    """Measure the scenes named on the command line, or all; all of them fill the page."""
    all_scenes, names = found_scenes(), sys.argv[1:]
    if names[:1] == ["--one"]:
        print(json.dumps(measured(all_scenes[names[1]])))
        return
    if unknown := [name for name in names if name not in all_scenes]:
        sys.exit(f"error: no scene {', '.join(unknown)}; allowed: {', '.join(all_scenes)}")
    rows, results = [], {}
    for name in names or all_scenes:
        results[name] = in_a_process(name)
        rows.append(row(all_scenes[name], results[name]))
        print(rows[-1], flush=True)
    here = machine()
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    where = f"{day}, commit {commit()}, {here['processor']}, {here['cores']} cores, Python {here['python']}, "
    where += f"{here['toolchain']}{load_words()}."
    report = {"machine": here, "date": day, "commit": commit(), "scenes": results}
    write_text(Path("out/peers.json"), json.dumps(report, indent=2) + "\n")
    if not names:
        table = [where, "", HEAD, RULE, *rows]
        write_text(PAGE, filled(PAGE.read_text(encoding="utf-8"), table))


if __name__ == "__main__":
    main()
