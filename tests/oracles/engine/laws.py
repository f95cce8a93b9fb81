"""Second writings of the elements' laws, one for each kind; what has none makes this engine refuse.

Each family has a ``functools.singledispatch`` function over its kinds: ``path_of`` and ``turn_of`` for
references, ``grasp_of`` for grasps, ``contact_of`` for contacts, ``tip_law`` and ``robot_law`` for
controllers, ``delivery_of`` for actuators, ``environment_of`` for environments.
"""

from __future__ import annotations

from typing import Any

from spacerobot.common.errors import ScenarioError
from spacerobot.elements import Element


def refusal(element: Element) -> ScenarioError:
    """Error for an element whose kind has no second writing."""
    return ScenarioError(
        f"the {element.family.replace('_', ' ')} kind {element.kind!r} has no second writing, so the "
        "pinocchio engine cannot check it; simulate with `simulation.engine: casadi`"
    )


def has_writing(family: Any, kind: type[Element]) -> bool:
    """Whether a kind has a second writing in its family's function."""
    return family.dispatch(kind) is not family.dispatch(object)
