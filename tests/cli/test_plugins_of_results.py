"""Results made with a plugin: it is found by name and hash, and run only where that is allowed."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from optim.campaign.store.folder import load_head, open_store
from spacerobot.cli import plugins
from spacerobot.common.errors import ResultError
from tests import forks

REPOSITORY = Path(__file__).parents[2]
LED = ("--set", "robots.*.tips.tip.reference={kind: lemniscate, duration: 2}")


@pytest.fixture(scope="module")
def spacerobot(tmp_path_factory):
    home = tmp_path_factory.mktemp("plugins")

    def run(*arguments):
        return forks.command(*arguments, folder=home, XDG_CONFIG_HOME=str(home / "config"))

    run.home = home
    return run


@pytest.fixture(scope="module")
def made(spacerobot):
    """A result and the plugin it was made with."""
    plugin = spacerobot.home / "mine.py"
    shutil.copy(REPOSITORY / "examples" / "plugins" / "lemniscate.py", plugin)
    result = spacerobot.home / "result"
    short = ("--set", "simulation.duration=0.1", "--backend", "interpreted")
    done = spacerobot("run", "paper", "--plugin", plugin, *LED, *short, "--out", result)
    assert done.returncode == 0, done.stderr
    return result, plugin


def test_a_result_keeps_name_and_hash(made):
    result, plugin = made
    (record,) = json.loads((result / "summary.json").read_text())["plugins"]
    assert record == {"file": str(plugin), "sha256": hashlib.sha256(plugin.read_bytes()).hexdigest()}


def test_it_is_refused_in_one_line_where_nobody_can_be_asked_and_runs_once_allowed(spacerobot, made):
    result, plugin = made
    page = spacerobot.home / "page.html"
    for command in (("animate", result, "--html", page), ("report", result), ("figures", result)):
        done = spacerobot(*command)
        assert done.returncode == 2
        (line,) = done.stderr.strip().splitlines()
        assert f"allow it by --plugin {plugin}" in line
        assert not page.exists()
    given = spacerobot("animate", result, "--html", page, "--plugin", plugin)
    assert given.returncode == 0, given.stderr
    trusted = spacerobot.home / "config" / "spacerobot" / "trusted_plugins"
    assert str(trusted) in line
    trusted.parent.mkdir(parents=True)
    trusted.write_text(f"{hashlib.sha256(plugin.read_bytes()).hexdigest()}  {plugin}\n")
    page.unlink()
    listed = spacerobot("animate", result, "--html", page)
    assert listed.returncode == 0, listed.stderr
    assert page.exists()


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A folder whose summary names a plugin that leaves a trace when it is run."""
    monkeypatch.setattr("spacerobot.elements.core.registry._PLUGINS", {})
    plugin, trace = tmp_path / "trace.py", tmp_path / "trace"
    plugin.write_text(f"open({str(trace)!r}, 'w').close()\n")
    folder = tmp_path / "result"
    folder.mkdir()
    record = {"file": str(plugin), "sha256": hashlib.sha256(plugin.read_bytes()).hexdigest()}
    (folder / "summary.json").write_text(json.dumps({"plugins": [record]}))
    return folder, plugin, trace


@pytest.mark.parametrize("inside", ["summary.json", "plan.json", "campaign.json", "point-1/plan.json"])
def test_results_plans_campaigns_and_plans_of_a_front_name_theirs(kept, monkeypatch, inside):
    folder, plugin, trace = kept
    (folder / inside).parent.mkdir(exist_ok=True)
    (folder / "summary.json").rename(folder / inside)
    monkeypatch.setattr(plugins, "_is_allowed", lambda _, path, sha256: path == plugin and bool(sha256))
    plugins.load_plugins_of([folder])
    assert trace.exists()


def test_a_campaign_keeps_its_plugins_also_where_it_is_opened_without_them(kept, monkeypatch, tmp_path):
    _, plugin, _ = kept
    campaign = tmp_path / "campaign"
    for known in ({plugin: plugin.read_bytes()}, {}):
        monkeypatch.setattr("spacerobot.elements.core.registry._PLUGINS", known)
        with open_store(campaign, {"fingerprint": "1"}, 1):
            pass
        (record,) = load_head(campaign)["plugins"]
        assert record == {"file": str(plugin), "sha256": hashlib.sha256(plugin.read_bytes()).hexdigest()}


@pytest.mark.parametrize("answer", [True, False])
def test_in_a_terminal_the_user_is_asked(kept, monkeypatch, tmp_path, answer):
    folder, plugin, trace = kept
    asked = []
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setattr("typer.confirm", lambda words, **_: (asked.append(words), answer)[1])
    if answer:
        plugins.load_plugins_of([folder])
    else:
        with pytest.raises(ResultError, match="--plugin"):
            plugins.load_plugins_of([folder])
    assert str(plugin) in asked[0]
    assert trace.exists() == answer


def test_a_plugin_that_changed_or_is_gone_is_not_run(kept, monkeypatch, tmp_path):
    folder, plugin, trace = kept
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    plugin.write_text(plugin.read_text() + "# more\n")
    with pytest.raises(ResultError, match=r"has changed since; name the file by --plugin FILE"):
        plugins.load_plugins_of([folder])
    plugin.unlink()
    with pytest.raises(ResultError, match=r"not at .*trace.py any more; name the file by --plugin FILE"):
        plugins.load_plugins_of([folder])
    assert not trace.exists()
