"""The studio's session: newest designs rolled out as they come, everything else in turn beside them."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from spacerobot.errors import SpaceRobotError
from spacerobot.result import Result
from spacerobot.rollout import Trajectory
from spacerobot.simulation import STEP_ERROR_LIMIT
from viz.page.animation import notices, run_data, shown_data
from viz.studio.jobs import Jobs
from viz.studio.keep import KINDS as SAVED
from viz.studio.keep import command_line, keep
from viz.studio.messages import Request, packets, read
from viz.studio.numbers import suggested
from viz.studio.plant import Origin, Plant, Plants

REST_S = 0.2
"""After so long without another design the last one is judged as ``spacerobot run`` would judge it."""

MOST_WAITING = 64
"""Requests other than designs and gradients that wait at most; one more is refused."""

NEWEST = ("set", "gradient")
"""Requests of which only a page's newest counts."""


class Page(Protocol):
    """A page that is connected."""

    def send(self, parts: Sequence[str | bytes]) -> None:
        """Send a message; from any thread."""

    @property
    def behind(self) -> bool:
        """Whether it has not taken what was sent to it before."""


class Session:
    """Answers what pages ask about designs of one scene.

    Parameters
    ----------
    origin
        What designs differ from.
    folder
        The only place where anything is written.
    tell
        Told in words what takes a while, before any page is there.

    Raises
    ------
    SpaceRobotError
        If the scene cannot be rolled out.
    """

    def __init__(self, origin: Origin, folder: Path, tell: Callable[[str], None] = lambda _: None) -> None:
        self.origin, self.folder = origin, folder
        self._pages: dict[Page, Plant] = {}
        self._tell = tell
        self.plants = Plants(origin, self._say)
        self._tell = lambda _: None
        self._newest: dict[tuple[Page, str], Request] = {}
        self._waiting: deque[tuple[Page, Request]] = deque()
        self._resting: dict[Page, Request] = {}
        self._change = threading.Condition()
        self._closed = False
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="studio beside")
        self._jobs = Jobs(self.plants, self._broadcast)
        self._thread = threading.Thread(target=self._work, name="studio", daemon=True)
        self._thread.start()
        self._beside.submit(self._prepare_base)  # nobody waits for them yet

    def greet(self, page: Page) -> None:
        """A page has connected; it is told what there is."""
        with self._change:
            self._pages[page] = self.plants.base
            self._newest[page, "set"] = Request("hello")
            self._change.notify()

    def leave(self, page: Page) -> None:
        """A page has gone; what it asked is forgotten, its jobs are stopped."""
        with self._change:
            self._pages.pop(page, None)
            self._resting.pop(page, None)
            for kind in NEWEST:
                self._newest.pop((page, kind), None)
            self._waiting = deque(pair for pair in self._waiting if pair[0] is not page)
        self._jobs.stop_all(page)

    def ask(self, page: Page, text: str | bytes) -> None:
        """A page asks something; returns at once."""
        try:
            request = read(text)
            if request.kind == "stop":
                self._jobs.stop(request.text("job"))
                return
            with self._change:
                if request.kind in NEWEST:
                    self._newest[page, request.kind] = request
                elif len(self._waiting) < MOST_WAITING:
                    self._waiting.append((page, request))
                else:
                    raise SpaceRobotError(f"{MOST_WAITING} requests are waiting; this one was not taken")
                self._change.notify()
        except SpaceRobotError as fault:
            self._fail(page, Request("message"), fault)

    def wake(self) -> None:
        """A page has taken what was sent to it."""
        with self._change:
            self._change.notify()

    def close(self) -> None:
        """Stop working."""
        with self._change:
            self._closed = True
            self._change.notify()
        self._jobs.stop_all()
        self._thread.join(10)
        self._beside.shutdown(wait=False, cancel_futures=True)

    def _work(self) -> None:
        while not self._closed:
            with self._change:
                if not self._change.wait_for(self._has_work, REST_S if self._resting else None):
                    page, request = self._resting.popitem()
                    request = Request("check", request.values, request.seq)
                elif self._closed:
                    return
                else:
                    page, request = self._take()
            self._attempt(self._answer, page, request)

    def _has_work(self) -> bool:
        return self._closed or bool(self._waiting) or any(not page.behind for page, _ in self._newest)

    def _take(self) -> tuple[Page, Request]:
        """Designs before gradients, and both before all else; a page that is behind waits."""
        for kind in NEWEST:
            for page, asked in list(self._newest):
                if asked == kind and not page.behind:
                    # to the end, so that pages take turns
                    return page, self._newest.pop((page, asked))
        return self._waiting.popleft()

    def _attempt(self, do: Callable[[Page, Request], None], page: Page, request: Request) -> None:
        try:
            do(page, request)
        except SpaceRobotError as fault:
            self._fail(page, request, fault)

    def _answer(self, page: Page, request: Request) -> None:
        if request.kind in ("hello", "set"):
            self._roll(page, request)
        elif request.kind == "check":
            self.origin.build(self.plants.changes(request.values))
        elif request.kind == "gradient":
            self._gradient(page, request)
        elif request.kind == "command":
            self._send(page, {"type": "command", "text": self._command(request)})
        elif request.kind == "save":
            self._beside.submit(self._attempt, self._save, page, request)
        else:
            self._jobs.begin(page, request)

    def _plant(self, page: Page, request: Request) -> tuple[Plant, dict[str, float]] | None:
        """Structure and numbers of a design; None while it is made, after which the request comes again."""
        found = self.plants.find(request.values)
        if found is None:
            self._beside.submit(self._attempt, self._make, page, request)
        return found

    def _make(self, page: Page, request: Request) -> None:
        with self._change:
            if (page, request.kind) in self._newest:
                return  # a newer one has come
        if self.plants.find(request.values) is None:
            self.plants.make(request.values)
        with self._change:
            if page in self._pages:
                self._newest.setdefault((page, request.kind), request)
                self._change.notify()

    def _roll(self, page: Page, request: Request) -> None:
        begin = time.perf_counter()
        found = self._plant(page, request)
        if found is None:
            return
        plant, numbers = found
        result, trajectory = plant.roll(numbers)
        if trajectory.status == "unclosed":
            raise SpaceRobotError(trajectory.cause)
        shown, summary = plant.look(result), result.summary
        if request.kind == "hello" or self._pages.get(page) is not plant:
            self._pages[page] = plant
            self._send(page, {**self._hello(plant), "seq": request.seq, "show": shown_data([shown])})
            if request.kind == "hello":
                request = Request("set")
        message = {
            "type": "rollout",
            "seq": request.seq,
            "status": trajectory.status,
            "words": _words(result, trajectory),
            "metrics": plant.metrics.values(trajectory.costs),
            "trusted": summary["status"]["trusted"],
            "warnings": notices(result, plant.scene),
            "outcome": summary["outcome"],
            "ledger": summary["ledger"],
            "events": summary["events"],
            "seconds": {"rollout": trajectory.wall_s, "all": time.perf_counter() - begin},
            "run": run_data(shown),
        }
        self._send(page, message)
        with self._change:
            self._resting[page] = request

    def _hello(self, plant: Plant) -> dict[str, Any]:
        sliders = suggested(plant.scene, plant.free)
        scenario = plant.scene.scenario
        return {
            "type": "hello",
            "scenario": scenario.name,
            "about": scenario.description,
            "folder": str(self.folder),
            "numbers": [leaf.plain(sliders.get(p), p in plant.free) for p, leaf in plant.leaves.items()],
            "metrics": [metric.plain() for metric in plant.metrics.metrics],
            "methods": list(self._jobs.methods),
            "saves": list(SAVED),
            "suggested": list(sliders),
        }

    def _gradient(self, page: Page, request: Request) -> None:
        found = self._plant(page, request)
        if found is None:
            return
        plant, numbers = found
        if not plant.has_gradients:
            self._beside.submit(self._attempt, self._prepare, page, request)
            return
        metric = plant.metric(request.text("metric"))
        value, slopes, status = plant.gradient(numbers, metric)
        wanted = request.more.get("paths", ())
        told = {path: slopes.get(path) for path in wanted if isinstance(path, str)}
        answer = {"type": "gradient", "seq": request.seq, "metric": metric.key, "value": value}
        self._send(page, {**answer, "d": told, "status": status})

    def _prepare_base(self) -> None:
        with suppress(SpaceRobotError):  # who asks for a gradient is told
            self.plants.base.prepare_gradients()
        self._say("")

    def _prepare(self, page: Page, request: Request) -> None:
        """Compile what gradients need, then ask again."""
        found = self.plants.find(request.values)
        if found is not None:
            self._say("compiling gradients")
            try:
                found[0].prepare_gradients()
            finally:
                self._say("")
            with self._change:
                if page in self._pages:
                    self._newest.setdefault((page, request.kind), request)
                    self._change.notify()

    def _command(self, request: Request) -> str:
        found = self.plants.find(request.values)
        chosen = found[0].chosen_step if found is not None else None
        return command_line(self.origin, self.plants.changes(request.values), chosen)

    def _save(self, page: Page, request: Request) -> None:
        what = request.text("what", tuple(SAVED))
        path = keep(what, request.text("name"), self.folder, self.origin, self.plants.changes(request.values))
        self._send(
            page, {"type": "saved", "what": what, "path": str(path), "command": self._command(request)}
        )

    def _fail(self, page: Page, request: Request, fault: SpaceRobotError) -> None:
        told = {"seq": request.seq, "what": request.kind, "path": fault.where, "message": fault.message}
        self._send(page, {"type": "failed", **told})

    def _send(self, page: Page, message: dict[str, Any]) -> None:
        page.send(packets(message))

    def _broadcast(self, page: Page | None, message: dict[str, Any]) -> None:
        for each in [page] if page is not None else list(self._pages):
            self._send(each, message)

    def _say(self, words: str) -> None:
        self._tell(words)
        self._broadcast(None, {"type": "compiling", "why": words})


def _words(result: Result, trajectory: Trajectory) -> str:
    """One line about a rollout that is not as it should be; else none."""
    if not result.completed:
        return "the rollout diverged" if trajectory.status == "diverged" else "events without end"
    if trajectory.step_error > STEP_ERROR_LIMIT:
        return f"steps of {trajectory.step_s:.3g} s are too long: one errs by {trajectory.step_error:.1e}"
    return ""
