"""Scenario files: what YAML may hold, and what it must not."""

from __future__ import annotations

import tracemalloc

import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.scenario.catalogue import find_scenario, shipped
from spacerobot.scenario.document import MAX_BYTES, parse_yaml, read_document
from spacerobot.scenario.load import to_yaml, validate


def refused(text: str, match: str) -> None:
    with pytest.raises(ScenarioError, match=match) as caught:
        parse_yaml(text, source="some.yaml")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("some.yaml")


def test_key_given_twice_is_refused_with_its_line():
    refused("a: 1\nb: 2\na: 3\n", r"line 3, column 1: key 'a' is given twice")
    refused("a: {b: 1, b: 2}", r"key 'b' is given twice")


@pytest.mark.parametrize("key", ["1", "[1, 2]", "{a: 1}", "null", "true", "1.5"])
def test_keys_are_names(key):
    refused(f"? {key}\n: 1\n", "keys are names")


@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.system ['true']",
        "!!python/name:os.system",
        "a: !!python/tuple [1, 2]",
        "!unknown 3",
    ],
)
def test_tags_that_make_objects_are_refused(text):
    refused(text, "could not determine a constructor")


@pytest.mark.parametrize(
    "value", ["!!binary gIGB", "!!timestamp 2001-01-01", "!!set {a, b}", "!!omap [a: 1]", "!!pairs [a: 1]"]
)
def test_values_are_plain(value):
    refused(f"a: {value}", "line 1, column 4: a [a-z]+, where plain values are allowed")
    assert parse_yaml("a: 2001-01-01") == {"a": "2001-01-01"}


@pytest.mark.parametrize("text", ["a: [1, 2", "a: b: c", "\t- x", "{", "a: *nothing", "'open", "a: \x00"])
def test_what_is_not_yaml_is_refused(text):
    refused(text, "some.yaml")


def test_alias_bombs_are_refused_quickly():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    refused("\n".join(lines), "unfolds to more than")
    merged = ["m0: &m0 {a: 1}"] + [f"m{i}: &m{i} {{x: *m{i - 1}, y: *m{i - 1}}}" for i in range(1, 60)]
    refused("\n".join(merged), "unfolds to more than")
    # merge keys, which PyYAML unfolds while it constructs: refused before, with little memory
    text = "m0: &m0 {a: 1}\n" + "\n".join(
        f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 10)}]}}" for i in range(1, 10)
    )
    tracemalloc.start()
    for bomb in (text, text.replace("m9: &m9 {", "? {").replace("*m8]}", "*m8]}\n: 1")):
        refused(bomb, "unfolds to more than|keys are names")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6
    refused("a: &a {<<: *a}", "unfolds to more than")
    assert parse_yaml("a: &a {b: 1, c: 2}\nd: {<<: *a, c: 3}\n") == {
        "a": {"b": 1, "c": 2},
        "d": {"b": 1, "c": 3},
    }


def test_values_that_hold_themselves_are_refused():
    refused("a: &a [*a]", "unfolds to more than")
    refused("a: &a {b: *a}", "unfolds to more than")


def test_deep_nesting_is_refused():
    refused("[" * 5000 + "]" * 5000, "nested too deeply")
    refused("a: " + "{a: " * 3000 + "1" + "}" * 3000, "nested too deeply")


def test_numbers_beyond_reason_are_refused():
    refused("a: " + "9" * 5000, "which is no int")


def test_aliases_and_merges_are_fine():
    value = parse_yaml("base: &b {x: 1, y: 2}\nother: {<<: *b, y: 3}\nsame: *b\n")
    assert value == {"base": {"x": 1, "y": 2}, "other": {"x": 1, "y": 3}, "same": {"x": 1, "y": 2}}


@pytest.mark.parametrize(
    ("text", "value"), [("1e-3", 1e-3), ("1E5", 1e5), ("-2.5e+3", -2500.0), ("3e0", 3.0)]
)
def test_exponents_need_no_point(text, value):
    """YAML 1.1 would read 1e-3 as a text."""
    document = parse_yaml(f"gravity: [{text}, 0, 0]\nrobots: {{a: {{urdf: x.urdf}}}}")
    assert validate(document).gravity[0] == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("010", 10),
        ("-007", -7),
        ("0.5", 0.5),
        (".5", 0.5),
        ("5.", 5.0),
        ("1:30", "1:30"),
        ("0x10", "0x10"),
        ("1_000", "1_000"),
        ("no", "no"),
        ("on", "on"),
        ("y", "y"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("null", None),
        ("-.inf", float("-inf")),
        ("1e400", float("inf")),
    ],
)
def test_plain_values_are_those_of_yaml_1_2(text, value):
    """YAML 1.1 takes 010 for 8, 1:30 for 90 and a joint called ``no`` for false."""
    found = parse_yaml(f"a: {text}")["a"]
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    "text",
    ["1e-3", "010", "08", "1:30", "no", "yes", "true", "~", "null", "", ".inf", "2001-01-01", "<<", "0x1"],
)
def test_texts_that_look_like_something_else_are_written_in_quotes(text):
    document = parse_yaml("robots: {a: {urdf: x.urdf}}") | {"description": text}
    written = to_yaml(validate(document))
    assert parse_yaml(written)["description"] == text
    assert validate(parse_yaml(written)).description == text


def test_faults_of_the_yaml_say_where_they_begin():
    refused("a: 1\nb: 'open\nc: 3\n", r"unexpected end of stream \(.*quoted scalar that begins in line 2\)")
    refused("a:\n\tb: 1", "line 2, column 1: .*indent with spaces, not tabs")


def test_control_characters_of_a_file_do_not_reach_the_terminal():
    with pytest.raises(ScenarioError) as caught:
        validate(parse_yaml('robots: {"a\\e[31m": {urdf: "x"}}'))
    assert "\x1b" not in str(caught.value)
    assert str(caught.value).isprintable()


def test_files_that_cannot_be_read(tmp_path):
    def fault(path, match):
        with pytest.raises(ScenarioError, match=match) as caught:
            read_document(path)
        assert str(path) in str(caught.value)

    fault(tmp_path / "none.yaml", "no such file")
    fault(tmp_path, "cannot be read")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"name: \xff\xfe")
    fault(binary, "not UTF-8 text: byte 6")
    large = tmp_path / "large.yaml"
    large.write_bytes(b" " * (MAX_BYTES + 1))
    fault(large, "larger than 5 MB")
    for text, kind in (("[1, 2]", "list"), ("3", "int"), ("", "NoneType")):
        other = tmp_path / "other.yaml"
        other.write_text(text, encoding="utf-8")
        fault(other, f"a scenario is a mapping of keys to values, found {kind}")


def test_finding_scenarios(tmp_path, monkeypatch):
    assert {"paper", "servicer"} <= set(shipped())
    assert find_scenario("paper") == shipped()["paper"]
    own = tmp_path / "own.yaml"
    own.write_text("robots: {}", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert find_scenario("own.yaml") == own
    with pytest.raises(ScenarioError, match="nor a shipped scenario; did you mean paper"):
        find_scenario("papr")
    with pytest.raises(ScenarioError, match="no such file"):
        find_scenario("papr.yaml")
    for name in ("a\x00b", "x" * 5000):
        with pytest.raises(ScenarioError):
            find_scenario(name)


@pytest.mark.parametrize("levels", [101, 400, 600, 3000])
def test_a_chain_of_aliases_that_is_merged_is_one_line(levels):
    """However deep: each level may need several calls of Python wherever it is walked."""
    chain = "".join(f"a{i}: &a{i} {{x: *a{i - 1}}}\n" for i in range(1, levels))
    with pytest.raises(ScenarioError, match="nested too deeply"):
        parse_yaml(f"a0: &a0 {{x: 1}}\n{chain}<<: {{name: *a{levels - 1}}}\n")


@pytest.mark.parametrize(
    "text", ["a: !!map [1]", "a: !!map x", "? !!map [1]\n: 2", "!!map 3", "a: !!seq {b: 1}"]
)
def test_a_tag_that_does_not_fit_its_node_is_refused(text):
    with pytest.raises(ScenarioError, match=r"line 1, column \d+: (found a|expected a) "):
        parse_yaml(text)
