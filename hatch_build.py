"""Build the rollout loops, for machines without a compiler; see docs/explanation/architecture.md."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FLAGS = ("-std=c++17", "-O2", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-w", "-fPIC")
ZIG = (sys.executable, "-m", "ziglang", "c++")
ZIG_FLAGS, ZIG_LINK_FLAGS = ("-fno-sanitize=all", "-DNO_RUNTIME", "-fno-exceptions"), ("-nostdlib",)
"""Without the run-time libraries of C++, which zig would build first in minutes."""


class LoopsHook(BuildHookInterface):
    """Compiles the loops into ``spacerobot/rollout/built``."""

    def dependencies(self) -> list[str]:
        """Zig's compiler for the time of the build, where there is no other."""
        return [] if _compiler() else ["ziglang>=0.13"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Compile; where that fails the package is built all the same, and compiles when it is first used."""
        if self.target_name != "wheel":
            return
        package = Path(self.root) / "spacerobot"
        spec = importlib.util.spec_from_file_location("tables", package / "rollout" / "kernel_tables.py")
        assert spec is not None
        assert spec.loader is not None
        tables = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(tables)
        source, compiler = tables.generic_source(package), _compiler() or list(ZIG)
        shutil.rmtree(package / "rollout" / "built", ignore_errors=True)
        for processor in tables.processors():
            target = tables.built_file(package, processor, source)
            target.parent.mkdir(exist_ok=True)
            is_zig = compiler == list(ZIG)
            flags = [*FLAGS, *(ZIG_FLAGS if is_zig else ()), *_processor_flags(processor, is_zig)]
            with tempfile.TemporaryDirectory() as folder:
                file, compiled = Path(folder) / "loops.cpp", Path(folder) / "loops.o"
                file.write_text(source, encoding="utf-8")
                link = [
                    *(ZIG_LINK_FLAGS if is_zig else ()),
                    "-s",
                    "-shared",
                    "-o",
                    str(target),
                    str(compiled),
                    "-lm",
                ]
                try:
                    for arguments in ([*flags, "-c", "-o", str(compiled), str(file)], link):
                        subprocess.run([*compiler, *arguments], check=True, capture_output=True)
                except (OSError, subprocess.CalledProcessError) as error:
                    told = getattr(error, "stderr", b"") or str(error).encode()
                    self.app.display_warning(
                        f"the loops were not built: {told.decode(errors='replace')[:300]}"
                    )
                    return
        build_data["artifacts"].append("/spacerobot/rollout/built/*.so")
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{platform}"


def _processor_flags(processor: str, is_zig: bool) -> list[str]:
    if not processor.startswith("x86-64"):
        return []
    return [f"-march={processor.replace('-', '_') if is_zig else processor}"]


def _compiler() -> list[str] | None:
    """The compiler that ``CXX`` names, or the first that is installed."""
    named = shlex.split(os.environ.get("CXX", ""))
    if named and shutil.which(named[0]):
        return named
    return next(([path] for name in ("g++", "clang++", "c++") if (path := shutil.which(name))), None)
