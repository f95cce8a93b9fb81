"""Flight software of Basilisk that holds the attitude of a base by wheels."""

from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback, rwMotorTorque
from Basilisk.simulation import simpleNav
from Basilisk.utilities import SimulationBaseClass, macros


def with_attitude_control(scene, gains=(30.0, 250.0), reference=(0.0, 0.0, 0.0)):
    """Close the loop from the state message of a scene module to its wheels; return the modules in order."""
    navigation, guidance = simpleNav.SimpleNav(), inertial3D.inertial3D()
    navigation.scStateInMsg.subscribeTo(scene.scStateOutMsg)
    guidance.sigma_R0N = list(reference)
    error, law = attTrackingError.attTrackingError(), mrpFeedback.mrpFeedback()
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    error.attRefInMsg.subscribeTo(guidance.attRefOutMsg)
    law.guidInMsg.subscribeTo(error.attGuidOutMsg)
    law.vehConfigInMsg.subscribeTo(scene.vehicleConfigOutMsg)
    law.rwParamsInMsg.subscribeTo(scene.rwParamsOutMsg)
    law.rwSpeedsInMsg.subscribeTo(scene.rwSpeedOutMsg)
    law.K, law.P, law.Ki = *gains, -1.0
    motors = rwMotorTorque.rwMotorTorque()
    motors.controlAxes_B = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    motors.vehControlInMsg.subscribeTo(law.cmdTorqueOutMsg)
    motors.rwParamsInMsg.subscribeTo(scene.rwParamsOutMsg)
    scene.rwMotorTorqueInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
    return navigation, guidance, error, law, motors


def simulated(period, duration, *modules):
    """Run modules in one task."""
    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", macros.sec2nano(period)))
    for module in modules:
        simulation.AddModelToTask("task", module)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(duration))
    simulation.ExecuteSimulation()
