"""Modules joined into one script, each in its own scope; libraries are named with their licences."""

import json
import re
from pathlib import Path

import pytest

import viz
from spacerobot.common.errors import SpaceRobotError
from viz.page.es_modules import joined

WEB = Path(viz.__file__).parent / "web"
MODULES = {
    "main.js": 'import { Shape, grown as larger } from "./parts/shape.js";\n'
    'import { size } from "./size.js";\nconst own = 4;\n'
    "window.found = [larger(size), new Shape().own, own];\n",
    "parts/shape.js": 'import { size, step$ } from "../size.js";\nconst own = 3;\n'
    "export class Shape { get own() { return own; } }\n"
    "function larger(from) { return from + size + step$; }\nexport{larger as grown};\n",
    "size.js": "export const size = 2;\nexport const step$ = 10;\nwindow.times = (window.times || 0) + 1;\n"
    "//# sourceMappingURL=size.js.map\n",
}


def test_each_module_runs_once_in_a_scope_of_its_own(browser):
    browser.open("about:blank")
    script = joined("main.js", MODULES.__getitem__)
    browser.evaluate(script)
    assert browser.evaluate("[...found, times, typeof own, typeof size]") == [
        14,
        3,
        4,
        1,
        "undefined",
        "undefined",
    ]
    assert "sourceMappingURL" not in script  # a browser's tools would ask for it
    assert joined("main.js", MODULES.__getitem__) == script


PLAYED = """
import { LEVELS, Quality } from "./quality.js";
const found = new Quality(() => {}, true);
let now = performance.now();
window.play = (gap, count) => {
  for (let k = 0; k < count; k++) found.tick((now += gap), true);
  return [found.level, LEVELS.length];
};
window.rest = (ms) => { found.tick((now += ms), false); return found.applied; };
"""


def test_what_is_drawn_gets_coarser_where_pictures_are_slow_and_finer_again_where_they_are_fast(browser):
    """Fast pictures are 16 ms apart, slow ones 60 ms; software begins at level 2 and ends at 5."""
    browser.open("about:blank")
    modules = {"quality.js": (WEB / "quality.js").read_text(), "test.js": PLAYED}
    browser.evaluate(joined("test.js", modules.__getitem__))
    assert browser.evaluate("play(16, 60)") == [2, 6]
    assert browser.evaluate("play(60, 12)[0]") == 3
    assert browser.evaluate("play(60, 60)[0]") == 5
    assert browser.evaluate("play(16, 60)[0]") == 5  # the level above was too slow a second ago
    assert browser.evaluate("play(30, 300)[0]") == 5  # a finer one would be too slow
    assert browser.evaluate("play(16, 40)[0]") < 5
    assert browser.evaluate("rest(600)") == 0  # what stands still is drawn in full


def test_captions_are_broken_between_their_parts(browser):
    """A picture 480 px wide cut the caption of a mission off."""
    browser.open("about:blank")
    text = (WEB / "image_export.js").read_text()
    function = text[text.index("export function inLines") :].split("\n}\n")[0].removeprefix("export ") + "\n}"
    lines = f"((text) => {{ {function}; return inLines(text, (line) => line.length <= 12); }})"
    assert browser.evaluate(f"{lines}('aaaa; bbbb; cccc; a part of its own; d')") == [
        "aaaa; bbbb",
        "cccc",
        "a part of its own",
        "d",
    ]
    assert browser.evaluate(f"{lines}('')") == [""]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('import { a } from "./other.js";\n', "in a circle: main.js -> other.js -> main.js"),
        ('import * as all from "./other.js";\n', "main.js: this form of import or export cannot be joined"),
        ("export default 3;\n", "export default 3;"),
        ("export let changing = 3;\n", "export let changing = 3;"),
    ],
)
def test_what_cannot_be_joined_is_refused(text, said):
    modules = {"main.js": text, "other.js": 'import { b } from "./main.js";\nexport const a = 1;\n'}
    with pytest.raises(SpaceRobotError, match=re.escape(said)):
        joined("main.js", modules.__getitem__)


def test_libraries_are_named_with_version_and_licence():
    told = (WEB / "vendor" / "README.md").read_text()
    tools = json.loads((WEB.parents[1] / "package.json").read_text())["devDependencies"]
    rows = re.findall(r"^\| (`.*`) \| (\w+) ([\d.]+) \| MIT, `(.*)` \|$", told, re.M)
    assert {name for _, name, *_ in rows} == {"uplot", "gifenc"}
    files = {"README.md", "gifenc.esm.d.ts"}
    for names, package, version, licence in rows:
        assert tools[package] == version
        assert "Permission is hereby granted" in (WEB / "vendor" / licence).read_text()
        files |= {licence, *re.findall(r"`([^`]+)`", names)}
    assert {file.name for file in (WEB / "vendor").iterdir()} == files
    assert "(v1.6.32)" in (WEB / "vendor" / "uPlot.iife.min.js").read_text()[:80]
