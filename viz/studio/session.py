"""Session of the studio: newest designs are rolled out first; files and jobs have threads of their own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.rollout.engine_factory import ADJOINT
from spacerobot.scene import load_scene
from spacerobot.simulation import STEP_ERROR_LIMIT
from viz.page.animation import notices, run_data, shown_data
from viz.page.meshcat_scene import Meshes
from viz.studio.bookmarks import KINDS as SAVED
from viz.studio.bookmarks import command_line, keep, place
from viz.studio.docking import Docking, UrdfChoice, plan
from viz.studio.job import Job
from viz.studio.jobs import Jobs
from viz.studio.messages import Request, packets, read
from viz.studio.metric_slopes import differences
from viz.studio.parameters import suggested
from viz.studio.prepared_design import DesignCache, Origin, PreparedDesign
from viz.studio.search import methods

REST_S = 0.2
"""Time without a new design after which the last one is checked as by ``spacerobot run`` [s]."""

MOST_WAITING = 16
"""Maximum number of files waiting to be written; further ones are refused."""

NEWEST = ("set", "gradient", "command", "urdfs", "draft", "open")
"""Requests of which only a page's newest is answered, in order of priority."""


class PageConnection(Protocol):
    """A page that is connected."""

    def send(self, parts: Sequence[str | bytes]) -> None:
        """Send a message; from any thread."""

    @property
    def behind(self) -> bool:
        """Whether the backlog of unsent messages is so long that further requests wait."""


class StudioSession:
    """Answers to requests of pages about designs of one scene.

    Args:
        origin: Scenario from which designs differ.
        folder: Only folder in which files are written.
        tell: Callback for a message before each long step, until a page is connected.

    Raises:
        SpaceRobotError: If the scene cannot be rolled out.
    """

    def __init__(self, origin: Origin, folder: Path, tell: Callable[[str], None] = lambda _: None) -> None:
        self.origin, self.folder = origin, folder
        self._choice, self._drafted = UrdfChoice(Path.cwd(), folder), set[Path]()
        self._pages: dict[PageConnection, PreparedDesign] = {}
        self._tell = tell
        self.plants = DesignCache(origin, self._say)
        self._tell = lambda _: None
        self._newest: dict[tuple[PageConnection, str], Request] = {}
        self._held: dict[tuple[PageConnection, str], Request] = {}
        self._making: set[tuple[PageConnection, str]] = set()
        self._resting: dict[PageConnection, Request] = {}
        self._waiting: deque[tuple[PageConnection, Request]] = deque()
        self._change = threading.Condition()
        self._closed = self._prepared = False
        self._jobs = Jobs(self.plants, self._broadcast, {"plan": self._plan_approach})
        self._thread = _begin(self._work)
        _begin(self._write)

    def greet(self, page: PageConnection) -> None:
        """Queue the initial data for a newly connected page."""
        with self._change:
            self._pages[page] = self.plants.base
            self._newest[page, "set"] = Request("hello")
            self._change.notify_all()

    def leave(self, page: PageConnection) -> None:
        """Drop the requests of a disconnected page, and stop its job."""
        with self._change:
            self._pages.pop(page, None)
            self._resting.pop(page, None)
            for kind in NEWEST:
                self._newest.pop((page, kind), None)
                self._held.pop((page, kind), None)
        self._jobs.stop_all(page)

    def ask(self, page: PageConnection, text: str | bytes) -> None:
        """Queue a request of a page, or begin or stop a job; returns at once."""
        request = Request("message")
        try:
            request = read(text)
            request.check()
            if request.kind == "stop":
                self._jobs.stop(request.text("job"))
            elif request.kind in NEWEST:
                with self._change:
                    self._held.pop((page, request.kind), None)
                    self._newest[page, request.kind] = request
                    self._change.notify_all()
            elif request.kind == "save":
                with self._change:
                    if len(self._waiting) >= MOST_WAITING:
                        raise SpaceRobotError(f"{MOST_WAITING} files wait to be written; request again later")
                    self._waiting.append((page, request))
                    self._change.notify_all()
            else:
                self._jobs.begin(page, request)
        except SpaceRobotError as fault:
            self._fail(page, request, fault)

    def wake(self) -> None:
        """Continue after a message to a page has been sent."""
        with self._change:
            self._change.notify_all()

    def close(self) -> None:
        """Stop working."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        self._jobs.stop_all()
        self._thread.join(5)

    def _work(self) -> None:
        """Answer requests, the most urgent first; check a design once it no longer changes."""
        while True:
            with self._change:
                work = self._change.wait_for(
                    lambda: self._closed or any(not page.behind for page, _ in self._newest),
                    REST_S if self._resting else None,
                )
                if self._closed:
                    return
                if work:
                    # the most urgent request; a page that is behind waits, and pages take turns
                    urgent = sorted(self._newest, key=lambda asked: NEWEST.index(asked[1]))
                    page, kind = next(asked for asked in urgent if not asked[0].behind)
                    request = self._newest.pop((page, kind))
                elif self._resting:  # else its page has gone meanwhile
                    page, request = self._resting.popitem()
                    request = Request("check", request.values, request.seq)
                else:
                    continue
            self._attempt(self._answer, page, request)

    def _write(self) -> None:
        """Write files, one after the other."""
        while True:
            with self._change:
                self._change.wait_for(lambda: self._closed or self._waiting)
                if self._closed:
                    return
                page, request = self._waiting.popleft()
            self._attempt(self._save, page, request)

    def _attempt(
        self, do: Callable[[PageConnection, Request], None], page: PageConnection, request: Request
    ) -> None:
        try:
            do(page, request)
        except SpaceRobotError as fault:
            self._fail(page, request, fault)
        except Exception as fault:  # a defect must not end the session for all pages
            self._fail(page, request, SpaceRobotError(f"a defect: {type(fault).__name__}: {fault}"))

    def _answer(self, page: PageConnection, request: Request) -> None:
        if request.kind in ("hello", "set"):
            self._roll(page, request)
        elif request.kind == "check":
            if not self._prepared:
                self._prepared = True
                _begin(self._prepare_early)
            self.origin.build(self.plants.changes(request.values))
        elif request.kind == "gradient":
            self._gradient(page, request)
        elif request.kind == "urdfs":
            sent = request.more.get("text")
            name = self._choice.upload(request.text("name"), request.text("text")) if sent else None
            self._send(page, {"type": "urdfs", "files": list(self._choice.files()), "uploaded": name})
        elif request.kind == "draft":
            self._send(page, Docking.of(request, self._choice).plain(request, self._choice))
        elif request.kind == "open":
            _begin(lambda: self._attempt(self._open, page, request))
        else:
            self._send(page, {"type": "command", "text": self._command(request)})

    def _open(self, _: PageConnection, request: Request) -> None:
        """Write a drafted docking, and work on it from now on."""
        docking = Docking.of(request, self._choice)
        if docking.file.exists() and docking.file not in self._drafted:
            raise ScenarioError("exists already; choose another name", source=docking.file)
        self._drafted.add(docking.write())
        self._move(docking.file)

    def _move(self, file: Path) -> None:
        """Work on another scenario; every page opens again."""
        origin = Origin(load_scene(file), str(file))
        plants = DesignCache(origin, self._say)
        with self._change:
            self.origin, self.plants, self._jobs.plants, self._prepared = origin, plants, plants, False
            self._newest.clear()
            self._resting.clear()
        self._broadcast(None, {"type": "moved"})

    def _plan_approach(
        self, plants: DesignCache, _: PreparedDesign, __: Mapping[str, float], job: Job
    ) -> None:
        """Plan the approach of a design, and work on the scenario that follows the plan."""
        scene = plants.origin.build(plants.changes(job.request.values))
        followed = plan(scene, place(self.folder, f"{scene.scenario.name}-plan", ""), job)
        if followed is not None:
            self._move(followed)

    def _plant(
        self, page: PageConnection, request: Request, *, gradients: bool = False
    ) -> tuple[PreparedDesign, dict[str, float]] | None:
        """Structure and numbers of a design; None while it is compiled, whereupon the request comes again."""
        design = self.plants.find(request.values)
        if design is not None and (design[0].has_gradients or not gradients):
            return design
        key = page, request.kind
        with self._change:
            self._held[key] = request
            if key not in self._making:
                self._making.add(key)
                _begin(lambda: self._attempt(self._make, page, request))
        return None

    def _make(self, page: PageConnection, request: Request) -> None:
        """Prepare the structure of a request's design, and then process the newest request again."""
        try:
            if self.plants.find(request.values) is None:
                self.plants.make(request.values)
            if request.kind == "gradient":
                self._prepare(request)
        except SpaceRobotError:
            with self._change:
                newest = self._held.get((page, request.kind)) is request
                if newest:
                    del self._held[page, request.kind]
            if newest:
                raise
        finally:
            with self._change:
                self._making.discard((page, request.kind))
                again = self._held.pop((page, request.kind), None)
                if again is not None and page in self._pages:
                    self._newest.setdefault((page, request.kind), again)
                    self._change.notify_all()

    def _prepare(self, request: Request) -> None:
        design = self.plants.find(request.values)
        try:
            if design is not None:
                design[0].prepare_gradients()
        finally:
            self._broadcast(None, {"type": "compiling", "what": "gradients", "why": ""})

    def _prepare_early(self) -> None:
        """Compile gradients of the scene as soon as a page shows it, before the first request for them."""
        with suppress(SpaceRobotError):  # who asks is told
            self._prepare(Request("gradient"))

    def _roll(self, page: PageConnection, request: Request) -> None:
        begin = time.perf_counter()
        design = self._plant(page, request)
        if design is None:
            return
        plant, numbers = design
        scene = plant.drawn(numbers)
        result, trajectory = plant.roll(scene, numbers)
        if trajectory.status == "unclosed":
            raise SpaceRobotError(trajectory.cause)
        animated, summary = plant.look(scene, result), result.summary
        if request.kind == "hello" or self._pages.get(page) is not plant:
            self._pages[page] = plant
            sliders = suggested(plant.scene, plant.free)
            scenario, original_leaves = (
                plant.scene.scenario,
                self.plants.base.leaves,
            )  # what designs differ from
            hello = {
                "type": "hello",
                "scenario": scenario.name,
                "about": scenario.description,
                "folder": str(self.folder),
                "numbers": [
                    leaf.plain(sliders.get(path), path in plant.free)
                    | {"value": original_leaves.get(path, leaf).value}
                    for path, leaf in plant.leaves.items()
                ],
                "metrics": [metric.plain() for metric in plant.metrics.metrics],
                "methods": [list(named) for named in methods().items()],
                "saves": list(SAVED),
                "suggested": list(sliders),
                "plans": scenario.plan is not None,
                "seq": request.seq,
                "show": shown_data([animated]),
            }
            self._send(page, hello)
            if request.kind == "hello":
                request = Request("set")
        # one line about a rollout that is not as it should be
        words = ""
        if not result.completed:
            words = "the rollout diverged" if trajectory.status == "diverged" else "events without end"
        elif trajectory.step_error > STEP_ERROR_LIMIT:
            step, error = trajectory.step_s, trajectory.step_error
            words = f"steps of {step:.3g} s are too long: one errs by {error:.1e}"
        message: dict[str, Any] = {
            "type": "rollout",
            "seq": request.seq,
            "status": trajectory.status,
            "words": words,
            "metrics": plant.metrics.values(trajectory.costs),
            "trusted": summary["status"]["trusted"],
            "warnings": notices(result, scene),
            "outcome": summary["outcome"],
            "ledger": summary["ledger"],
            "events": summary["events"],
            "seconds": {"rollout": trajectory.wall_s, "all": time.perf_counter() - begin},
            "run": run_data(animated),
        }
        if scene.scenario.pads:  # their shapes may have changed
            nodes = animated.motion.nodes
            message["run"]["nodes"] = Meshes(nodes).node_data(nodes)
        self._send(page, message)
        with self._change:
            self._resting[page] = request

    def _gradient(self, page: PageConnection, request: Request) -> None:
        """Send derivatives of a metric: exact ones, or differences while these are not compiled."""
        requested = request.more.get("paths", ())
        missing = [path for path in requested if isinstance(path, str)] if isinstance(requested, list) else []
        metric_key = request.text("metric")
        design = self._plant(page, request, gradients=True)
        exact = design is not None
        design = design or self.plants.find(request.values)
        if design is None:
            return
        plant, numbers = design
        metric = plant.metrics[metric_key]
        answer = {"type": "gradient", "seq": request.seq, "metric": metric.key}
        status = "differences"
        if exact:
            value, slopes, status = plant.gradient(numbers, metric, missing)
            slopes_by_path = {path: slopes.get(path) for path in missing}
            self._send(page, {**answer, "value": value, "d": slopes_by_path, "status": status})
            missing = [path for path in missing if slopes_by_path[path] is None] if value is not None else []
        for part in differences(plant, numbers, metric, missing, self._is_hurried):
            self._send(page, {**answer, "d": part, "status": status})

    def _is_hurried(self) -> bool:
        """Whether a design is waiting to be rolled out, or the session is closed."""
        with self._change:
            return self._closed or any(kind == "set" for _, kind in self._newest)

    def _command(self, request: Request) -> str:
        design = self.plants.find(request.values)
        chosen = design[0].chosen_step if design is not None else None
        return command_line(self.origin, self.plants.changes(request.values), chosen)

    def _save(self, page: PageConnection, request: Request) -> None:
        what = request.text("what", tuple(SAVED))
        changes = self.plants.changes(request.values)

        def tell(words: str) -> None:
            self._send(page, {"type": "saving", "what": what, "words": words})

        path = keep(what, request.text("name"), self.folder, self.origin, changes, tell)
        self._send(
            page, {"type": "saved", "what": what, "path": str(path), "command": self._command(request)}
        )

    def _fail(self, page: PageConnection, request: Request, fault: SpaceRobotError) -> None:
        failure = {"seq": request.seq, "what": request.kind, "path": fault.where, "message": fault.message}
        self._send(page, {"type": "failed", **failure})

    def _send(self, page: PageConnection, message: dict[str, Any]) -> None:
        page.send(packets(message))

    def _broadcast(self, page: PageConnection | None, message: dict[str, Any]) -> None:
        for each in [page] if page is not None else list(self._pages):
            self._send(each, message)

    def _say(self, words: str) -> None:
        self._tell(words)
        what = "gradients" if ADJOINT in words else "loop"
        self._broadcast(None, {"type": "compiling", "what": what, "why": words})


def _begin(work: Callable[[], None]) -> threading.Thread:
    """Start a daemon thread, which does not keep the program running."""
    thread = threading.Thread(target=work, name="studio", daemon=True)
    thread.start()
    return thread
