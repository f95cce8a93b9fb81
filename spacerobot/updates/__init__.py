"""Controllers with a Python update: their held values change between the segments of a rollout."""

from spacerobot.updates.batch import UpdatedRollout as UpdatedRollout
from spacerobot.updates.plant import Ends as Ends
from spacerobot.updates.plant import Rows as Rows
from spacerobot.updates.plant import UpdatedPlant as UpdatedPlant
from spacerobot.updates.scheme import UpdatedScene as UpdatedScene
from spacerobot.updates.scheme import Updates as Updates
from spacerobot.updates.scheme import UpdateScheme as UpdateScheme
from spacerobot.updates.scheme import run_updates as run_updates
