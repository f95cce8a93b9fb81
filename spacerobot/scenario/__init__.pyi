"""Public names and their modules; :mod:`spacerobot.common.lazy_names` loads a name when it is first used."""

from spacerobot.scenario.bodies import Base as Base
from spacerobot.scenario.bodies import Body as Body
from spacerobot.scenario.bodies import Joint as Joint
from spacerobot.scenario.bodies import Link as Link
from spacerobot.scenario.bodies import Robot as Robot
from spacerobot.scenario.bodies import Target as Target
from spacerobot.scenario.bodies import Tip as Tip
from spacerobot.scenario.campaign import Campaign as Campaign
from spacerobot.scenario.campaign import Limits as Limits
from spacerobot.scenario.campaign import UncertainParameter as UncertainParameter
from spacerobot.scenario.scenario import Scenario as Scenario
from spacerobot.scenario.scenario import Simulation as Simulation
from spacerobot.scenario.tuning import Constraints as Constraints
from spacerobot.scenario.tuning import DesignVariable as DesignVariable
from spacerobot.scenario.tuning import Objective as Objective
from spacerobot.scenario.tuning import Robustness as Robustness
from spacerobot.scenario.tuning import Tuning as Tuning
