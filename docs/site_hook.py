"""What the site shows beside ``docs``: examples and the project's pages, with links that work in both."""

from __future__ import annotations

import importlib
import posixpath
import re
from pathlib import Path
from typing import Any

import reference_pages
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

from spacerobot.common.lazy_names import IMPORT

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")
NAMES = re.compile(r"^<!-- names of ([\w.]+) -->$", re.MULTILINE)
GENERATED = re.compile(r"^<!-- generated: ([\w ]+) -->$(?:\n> .*$)*", re.MULTILINE)
ROLE = re.compile(r":(?:class|func|meth|mod|data|attr):<code>(?:~(?:\w+\.)*)?")
NAMES_AS_TYPE = re.compile(
    r"(<b><code>)([^\n]*?,[^\n]*?)(</code></b>)\s*\(<code>\(?(.*?)\)?</code>\)(?=\s*–)"
)
"""Several attributes of one line, ``first, second: ...``: the generator takes the second for a type."""
TITLE = re.compile(r"(?<=>)[^<]*(?=(?:<[^>]*>[^<]*</a>)?</h1>)")
TAG = re.compile(r"(<[^>]+>)")
WHOLE = re.compile(r"--[a-z][\w-]*|\d(?:\.\d+)?e-\d+")
"""Options and powers of ten, at whose hyphens a browser would break the line."""


def elsewhere() -> dict[str, str]:
    """Pages that are no files of ``docs``: place in the site by place in the repository."""
    pages = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
    pages["examples/README.md"] = "examples/README.md"
    for file in sorted((ROOT / "examples").rglob("*.py")):
        name = file.relative_to(ROOT).as_posix()
        pages[name] = name.removesuffix(".py") + ".md"
    for kind in ("ipynb", "urdf"):  # files to load
        for file in sorted((ROOT / "examples").rglob(f"*.{kind}")):
            pages[file.relative_to(ROOT).as_posix()] = file.relative_to(ROOT).as_posix()
    return pages


PAGES = elsewhere()
ORIGINS = {site: repository for repository, site in PAGES.items()}


def on_files(files: Files, config: Any) -> Files:
    """Add the pages from elsewhere; a script is a page with its text."""
    for repository, site in PAGES.items():
        if not site.endswith(".md"):
            files.append(File.generated(config, site, abs_src_path=str(ROOT / repository)))
            continue
        text = (ROOT / repository).read_text(encoding="utf-8")
        inclusion = InclusionLevel.INCLUDED
        if repository.endswith(".py"):  # reached from the page of examples
            text = f"---\nhide: [toc]\n---\n# {Path(repository).name}\n\n```python\n{text}```\n"
            inclusion = InclusionLevel.NOT_IN_NAV
        files.append(File.generated(config, site, content=text, inclusion=inclusion))
    return files


def names_of(package: str) -> str:
    """Reference of the names that a package loads from its own modules when they are used, figures aside."""
    module = importlib.import_module(package)
    stub = Path(str(module.__file__)).with_suffix(".pyi").read_text(encoding="utf-8")
    homes = {}
    for stub_module, name in IMPORT.findall(stub):
        own = getattr(getattr(module, name), "__module__", None) or ""  # data and aliases of types have none
        homes[name] = own if own.startswith(package) else stub_module
    return "\n\n".join(
        f"::: {home}.{name}"
        for name, home in homes.items()
        if home.startswith(f"{package}.") and ".figures" not in home
    )


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:
    """Links of the repository become links of the site."""
    here = page.file.src_uri
    origin = ORIGINS.get(here, f"docs/{here}")

    def moved(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(origin), match[1]))
        if target == "examples/plugins":
            target = "examples/README.md"
        site = PAGES.get(target, target.removeprefix("docs/"))
        return posixpath.relpath(site, posixpath.dirname(here) or ".")

    linked = LINK.sub(moved, markdown)
    named = NAMES.sub(lambda match: names_of(match[1]), linked)
    return GENERATED.sub(lambda match: reference_pages.PAGES[match[1]](), named)


def unbroken(html: str) -> str:
    """HTML whose options and numbers stay on one line, outside blocks of code and formulas."""
    parts = TAG.split(html)
    block = False
    for k, part in enumerate(parts):
        if k % 2:
            block = (block or part.startswith("<pre")) and part != "</pre>"
        elif not block and 'class="arithmatex"' not in parts[k - 1]:
            part = re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", part)
            parts[k] = WHOLE.sub(r'<span class="whole">\g<0></span>', part)
    return "".join(parts)


def on_page_content(html: str, page: Page, config: Any, files: Files) -> str:
    """Docstrings without the marks of roles, with every name of a line; names break at underscores alone."""
    described = NAMES_AS_TYPE.sub(r"\1\2 \4\3", ROLE.sub("<code>", html))
    return TITLE.sub(lambda match: match[0].replace("_", "_<wbr>"), unbroken(described))
