"""Evaluator of a campaign, rebuilt from its folder."""

from __future__ import annotations

from pathlib import Path

from optim.campaign.rollouts.evaluator import CampaignEvaluator, all_draws, build_evaluator
from optim.campaign.store.folder import HEAD, difference, load_head, open_store
from optim.campaign.store.netcdf import DATA, check_layout, is_complete
from optim.campaign.store.run_settings import named_in
from spacerobot.common.errors import ResultError, SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene
from spacerobot.scene.resolve import read_descriptions

AGAIN = "run the campaign again in another folder"


def reopen(folder: StrPath) -> CampaignEvaluator:
    """Evaluator of the campaign in a folder, without compilation; parts of its store are merged.

    Args:
        folder: Folder that ``spacerobot campaign`` or :func:`optim.campaign.run_campaign` wrote, complete or
            not.

    Raises:
        ResultError: If the folder has no campaign or no sample, another process writes it, another version of
            the library wrote it, a URDF has changed since, or its data are damaged.
    """
    folder = Path(folder)
    head = load_head(folder)
    try:
        # refuse a folder whose URDFs are not those that its numbers were made with
        for path, description in read_descriptions(head["scenario"], source=folder / HEAD).items():
            name = path.removeprefix("robots.")
            if description.sha256 != head["urdf"][name]:
                raise ResultError(
                    f"the URDF of {name}, {description.path}, has changed since; put the old one back, or "
                    f"{AGAIN}",
                    source=folder,
                )
        document = dict(head["scenario"])
        document["campaign"] = document["campaign"] | head["notes"]["asked"]
        source = folder / HEAD
        scene = build_scene(validate(document, source=source), source=source)
        evaluator = build_evaluator(scene, head["gains"], compiled=False)
        draws = all_draws(evaluator)
        about = head["notes"]["about"]
        named_in(head["notes"])
    except (KeyError, TypeError, AttributeError) as fault:
        raise ResultError(f"is no campaign's: {fault!r}", source=folder / HEAD) from None
    except ResultError:
        raise
    except SpaceRobotError as fault:
        message = f"cannot be made a scene again: {fault.message}"
        raise ResultError(message, source=folder / HEAD, where=fault.where) from None
    identity = evaluator.identity(draws)
    differs = difference(head, identity)
    if differs is not None:
        what = f" ({differs})" if differs else ""
        raise ResultError(f"made by another version of the library{what}; {AGAIN}", source=folder)
    if not is_complete(folder / DATA, len(draws)):
        with open_store(folder, identity, len(draws)) as store:
            if not store.done:
                raise ResultError("holds no sample yet; start its campaign again to continue", source=folder)
            store.merge(evaluator, about)
    check_layout(folder / DATA, evaluator)
    return evaluator
