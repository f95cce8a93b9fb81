"""A docking of one's own from the studio: which URDFs a page may name, the draft, its opening, its plan."""

import re

import pytest

from spacerobot.common.errors import SpaceRobotError
from spacerobot.drafting import DraftRequest, draft_capture
from spacerobot.scenario.document import parse_yaml
from spacerobot.scene import load_scene
from tests.oracles import one_arm
from tests.viz.studio.conftest import Asker
from viz.studio.docking import UrdfChoice
from viz.studio.messages import Request, read
from viz.studio.prepared_design import Origin
from viz.studio.server import Studio
from viz.studio.session import StudioSession

MINE = {"name": "mine", "robot": "arm.urdf", "target": "rectangle.urdf"}
MESH = (
    "<robot name='a'><link name='a'><visual><geometry><mesh filename={}/></geometry></visual></link></robot>"
)


@pytest.fixture
def served(tmp_path, monkeypatch):
    """A session that was started in a folder with an arm, and its page; nothing is compiled."""
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    working = tmp_path / "working"
    working.mkdir()
    file = one_arm.write(working)
    monkeypatch.chdir(working)
    session = StudioSession(Origin(load_scene(file), str(file)), working / "out")
    page = Asker(session)
    session.greet(page)
    page.take("rollout")
    yield session, page
    session.close()


def test_a_page_names_urdfs_of_the_working_folder_and_no_others(tmp_path):
    working, out = tmp_path / "working", tmp_path / "working" / "out"
    (working / "arms").mkdir(parents=True)
    for place in (working / "arms" / "mine.urdf", tmp_path / "theirs.urdf"):
        place.write_text("<robot/>")
    (working / "link.urdf").symlink_to(tmp_path / "theirs.urdf")
    choice = UrdfChoice(working, out)
    files = choice.files()
    assert files["arms/mine.urdf"] == working / "arms" / "mine.urdf"
    assert "panda_arm.urdf" in files
    for name in ("link.urdf", "../theirs.urdf", str(tmp_path / "theirs.urdf"), ""):
        with pytest.raises(SpaceRobotError, match="not offered"):
            choice.find(name)


@pytest.mark.parametrize(
    "text",
    [
        *map(MESH.format, ("'/etc/passwd'", '"../x.stl"', "'a/../../x'", "'file:///x'", '"package://a/b"')),
        "<robot xmlns:xacro='http://ros.org/wiki/xacro'/>",
        "<!DOCTYPE r [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><robot/>",
    ],
)
def test_an_uploaded_urdf_leads_to_no_other_files(tmp_path, text):
    with pytest.raises(SpaceRobotError, match="allowed in an uploaded URDF"):
        UrdfChoice(tmp_path, tmp_path).upload("a.urdf", text)
    assert list(tmp_path.iterdir()) == []


def test_an_uploaded_urdf_is_written_into_the_folder_alone(tmp_path):
    choice = UrdfChoice(tmp_path / "working", tmp_path / "out")
    assert choice.upload("../../a.urdf", MESH.format("'meshes/a.stl'")) == "a.urdf"
    assert choice.find("a.urdf") == tmp_path / "out" / "a.urdf"
    for name in ("..", "con.urdf", "a b.urdf", ""):
        with pytest.raises(SpaceRobotError, match="name"):
            choice.upload(name, "<robot/>")


def short(order, file):
    """A draft that is simulated and planned in no time."""
    text, scene = draft_capture(order, file)
    text = text.replace("  duration: 16\n", "  duration: 3\n")
    brief = "simulation: {duration: 0.2, step: 0.02, output_step: 0.1}"
    return re.sub("simulation: .*", brief, text), scene


def test_a_docking_is_drafted_placed_opened_and_planned(served, monkeypatch):
    session, page = served
    page.ask("urdfs")
    assert "arm.urdf" in page.take("urdfs")["files"]
    page.ask("draft", **MINE)
    draft = page.take("draft", "failed")
    text, scene = draft_capture(DraftRequest(["arm.urdf"], "rectangle.urdf"), session.folder / "mine.yaml")
    assert draft["text"] == text  # as `spacerobot new --capture` drafts it
    assert draft["place"]["position"] == list(scene.scenario.target.base.position)
    assert draft["chosen"]["frame"] in draft["frames"]
    assert not (session.folder / "mine.yaml").exists()
    x, y, z = draft["place"]["position"]
    page.ask("draft", **MINE, position=f"{x + 0.01}, {y}, {z}", spin_deg="0, 0, 0.5")
    placed = parse_yaml(page.take("draft", "failed")["text"])["target"]["base"]
    assert placed["position"] == [x + 0.01, y, z]
    assert placed["spin_deg"] == [0, 0, 0.5]
    page.ask("draft", **MINE, position="1, 2")
    assert "three numbers" in page.take("failed")["message"]

    monkeypatch.setattr("viz.studio.docking.draft_capture", short)
    page.ask("open", **MINE)
    page.take("moved")
    assert session.origin.scene.source == session.folder.resolve() / "mine.yaml"
    again = Asker(session)
    session.greet(again)
    hello = again.take("hello")
    assert (hello["scenario"], hello["plans"]) == ("mine", True)
    again.take("rollout")

    again.ask("plan")
    assert re.search(r"cost \d+", again.take("job", until=lambda job: job["state"] == "done")["message"])
    again.take("moved")
    assert session.origin.scene.source.parent.name == "mine-plan"
    assert "kind: plan" in session.origin.scene.source.read_text()


def test_a_file_that_is_there_is_not_overwritten(served):
    session, page = served
    session.folder.mkdir()
    (session.folder / "mine.yaml").write_text("name: theirs\n")
    page.ask("open", **MINE)
    assert "exists already" in page.take("failed")["message"]
    assert (session.folder / "mine.yaml").read_text() == "name: theirs\n"
    page.ask("open", **MINE | {"name": "../mine"})
    assert "found the name" in page.take("failed")["message"]


def test_requests_are_known():
    assert read('{"type": "draft", "robot": "a.urdf"}') == Request("draft", more={"robot": "a.urdf"})


def test_a_docking_is_opened_and_planned_in_a_browser(browser, tmp_path, monkeypatch):
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("viz.studio.docking.draft_capture", short)
    file = one_arm.write(tmp_path)
    drawn = "Number(document.body?.dataset.drawn) >= 1"
    with Studio(Origin(load_scene(file), str(file)), tmp_path / "out", 7640) as studio:
        browser.open(f"{studio.url}#t=0&play=0&scheme=dark")
        browser.wait_for(drawn)
        browser.evaluate("docking.open = true")
        browser.wait_for("document.querySelectorAll('#docking [name=robot] option').length > 5")
        choose = "((n, v) => { const e = document.querySelector(`#docking [name=${n}]`); e.value = v; "
        choose += "e.dispatchEvent(new Event('input', { bubbles: true })); })"
        browser.evaluate(f"{choose}('robot', 'arm.urdf'); {choose}('target', 'rectangle.urdf')")
        browser.wait_for("!document.querySelector('#docking .open').disabled")
        browser.evaluate("document.querySelector('#docking .open').click()")
        browser.wait_for(f"{drawn} && !docking.open && !document.querySelector('#jobs .plan').hidden")
        assert browser.evaluate("title.textContent") == "my-docking"
        browser.evaluate("document.querySelector('#jobs .plan').click()")
        browser.wait_for(f"{drawn} && title.textContent === 'my-docking-plan'")
        assert browser.evaluate("document.documentElement.dataset.scheme") == "dark"
        assert (tmp_path / "out" / "my-docking-plan" / "followed.yaml").exists()
        assert browser.errors == []
