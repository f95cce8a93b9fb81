"""Check that links and joints form one tree."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.description.parts import UrdfJoint, UrdfLink

MOST_LINKS = 1000
"""Maximum number of links: the model is built recursively."""


def root_link(links: Sequence[UrdfLink], joints: Sequence[UrdfJoint], source: Path) -> str:
    """Name of the root link, after a check that links and joints form one tree.

    Raises:
        DescriptionError: If there are no links, too many links, several roots, a link with two parents, a
            closed loop, or a joint with an unknown link.
    """
    if not links:
        raise DescriptionError("holds no link", source=source)
    if len(links) > MOST_LINKS:
        raise DescriptionError(f"holds {len(links)} links, allowed are {MOST_LINKS}", source=source)
    # joint above each link, by the link's name
    names = {link.name for link in links}
    parent_joint: dict[str, UrdfJoint] = {}
    for each in joints:
        where = f"joint {each.name!r}"
        for end, name in (("parent", each.parent), ("child", each.child)):
            if name not in names:
                raise DescriptionError(
                    f"{end} link {name!r} does not exist; {near_names(name, names)}",
                    source=source,
                    where=where,
                )
        if each.child in parent_joint:
            raise DescriptionError(
                f"gives link {each.child!r} a second parent, besides that of joint "
                f"{parent_joint[each.child].name!r}; a closed loop cannot be simulated",
                source=source,
                where=where,
            )
        parent_joint[each.child] = each
    roots = [link.name for link in links if link.name not in parent_joint]
    if len(roots) > 1:
        listed = ", ".join(roots)
        raise DescriptionError(f"{len(roots)} links have no parent ({listed}), allowed is one", source=source)
    if not roots:
        raise DescriptionError("every link has a parent: the joints close a loop", source=source)
    # the root and all links below it
    children: dict[str, list[str]] = defaultdict(list)
    for joint in joints:
        children[joint.parent].append(joint.child)
    reached, waiting = {roots[0]}, [roots[0]]
    while waiting:
        for child in children[waiting.pop()]:
            if child not in reached:
                reached.add(child)
                waiting.append(child)
    lost = {link.name for link in links} - reached
    if lost:
        joint = parent_joint[min(lost)]
        raise DescriptionError(
            f"closes a loop that {roots[0]!r} does not reach", source=source, where=f"joint {joint.name!r}"
        )
    return roots[0]
