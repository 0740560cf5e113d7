"""Drives a simulated UR controller with the unmodified client `ur-rtde` from PyPI (1.6.x).

    python ur_rtde_client.py HOST

The simulator must serve the real ports on HOST, without lock-step and in real time, its program list
must hold `production.urp`, and HOST must not be 127.0.0.1, for which the client skips a check. Prints
one line per check and ends with 0 where all hold, with 1 at the first that does not, or when the client
hangs. It takes about 30 s.
"""

import faulthandler
import math
import sys
import threading
import time
from importlib.metadata import version

from dashboard_client import DashboardClient
from rtde_control import Path, PathEntry, RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

# The client itself would wait for minutes.
LIMIT_S = 150
RUNNING, IDLE, POWER_OFF = 7, 5, 3
# The client sends a package of the wrong size for an offset of zeros.
ALMOST_NOTHING = [1e-12, 0.0, 0.0, 0.0, 0.0, 0.0]
began = time.monotonic()


def check(what, holds, seen=""):
    """Prints the outcome, and ends the script where it does not hold."""
    at = time.monotonic() - began
    print(f"{at:7.2f} s  {'ok    ' if holds else 'FAILED'}  {what}{'' if holds else f': {seen}'}", flush=True)
    if not holds:
        raise SystemExit(1)


def eventually(what, holds, within_s=2.0, seen=lambda: ""):
    """Checks that something becomes true in time; says how long it took."""
    start = time.monotonic()
    while not holds() and time.monotonic() - start < within_s:
        time.sleep(0.002)
    check(f"{what} ({time.monotonic() - start:.3f} s)", holds(), seen())


def apart(a, b):
    """Largest difference of components."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def refused(call):
    """The words of the exception that a call raises, or None."""
    try:
        call()
    except Exception as error:  # the client raises several kinds
        return str(error)
    return None


def moved(values, by):
    """The values, each with its change."""
    return [value + change for value, change in zip(values, by, strict=True)]


def sampled(receive, running, read):
    """What `read` gives every few milliseconds while `running` holds."""
    seen = []
    while running():
        seen.append(read())
        time.sleep(0.004)
    return seen


def upload_again(control):
    """Uploads the control script anew and waits until it runs."""
    check("reuploadScript", control.reuploadScript())
    eventually("the script runs", control.isProgramRunning)


def reading(receive):
    check("the receive interface gets samples", receive.isConnected() and receive.getTimestamp() > 0)
    before = receive.getTimestamp()
    time.sleep(0.5)
    passed = receive.getTimestamp() - before
    check("its time runs at real pace", 0.2 < passed < 0.9, passed)
    check("the robot runs, unstopped", receive.getRobotMode() == RUNNING and receive.getSafetyMode() == 1)
    check("joints agree with their targets", apart(receive.getActualQ(), receive.getTargetQ()) < 1e-3)
    vectors = [receive.getJointTemperatures(), receive.getActualCurrent(), receive.getPayloadInertia(),
               receive.getActualTCPForce(), receive.getFtRawWrench(), receive.getActualTCPPose()]
    check("vectors have six numbers", all(len(v) == 6 and all(map(math.isfinite, v)) for v in vectors), vectors)


def questions(dashboard):
    answers = {
        "polyscopeVersion": ("5.12.4.1101", dashboard.polyscopeVersion()),
        "robotmode": ("Robotmode: RUNNING", dashboard.robotmode()),
        "safetystatus": ("Safetystatus: NORMAL", dashboard.safetystatus()),
        "safetymode": ("Safetymode: NORMAL", dashboard.safetymode()),
        "getRobotModel": ("UR5", dashboard.getRobotModel()),
        "isInRemoteControl": (True, dashboard.isInRemoteControl()),
        "running": (False, dashboard.running()),
    }
    for name, (known, found) in answers.items():
        check(f"dashboard: {name} is {known}", known == found, found)
    check("dashboard: the serial number has digits", dashboard.getSerialNumber().isdigit())


def programs(dashboard, receive):
    missing = refused(lambda: dashboard.loadURP("absent.urp"))
    state, loaded = dashboard.programState(), dashboard.getLoadedProgram()
    named = state == "STOPPED <unnamed>" and loaded == "No program loaded"
    check("dashboard: nothing runs", named or state == "STOPPED production.urp", (state, loaded))
    check("dashboard: a missing program is refused", missing == "File not found: /programs/absent.urp", missing)
    dashboard.loadURP("production.urp")
    loaded = dashboard.getLoadedProgram()
    check("dashboard: a program is loaded", loaded == "Loaded program: /programs/production.urp", loaded)
    dashboard.play()
    eventually("dashboard: it plays", lambda: receive.getRuntimeState() == 2)
    check("dashboard: its name is shown", dashboard.programState() == "PLAYING production.urp", dashboard.programState())
    dashboard.pause()
    eventually("dashboard: it pauses", lambda: receive.getRuntimeState() == 4)
    dashboard.play()
    eventually("dashboard: it goes on", lambda: receive.getRuntimeState() == 2)
    dashboard.stop()
    eventually("dashboard: it stops", lambda: receive.getRuntimeState() == 1)
    dashboard.popup("hello")
    dashboard.closePopup()
    dashboard.addToLog("hello")
    dashboard.closeSafetyPopup()
    dashboard.send("make coffee\n")
    answer = dashboard.receive()
    check("dashboard: nonsense is not understood", answer == "could not understand: 'make coffee'", answer)


def power(dashboard, receive):
    dashboard.powerOff()
    eventually("dashboard: power off", lambda: receive.getRobotMode() == POWER_OFF)
    dashboard.powerOn()
    eventually("dashboard: power on leaves the brakes closed", lambda: receive.getRobotMode() == IDLE)
    check("dashboard: and says so", dashboard.robotmode() == "Robotmode: IDLE", dashboard.robotmode())
    dashboard.brakeRelease()
    eventually("dashboard: brakes released", lambda: receive.getRobotMode() == RUNNING)


def joint_moves(control, receive):
    start = receive.getActualQ()
    target = moved(start, [0.4, 0.1, -0.2, 0.1, 0.2, -0.3])
    clock = time.monotonic()
    check("moveJ returns True", control.moveJ(target, 1.0, 2.0))
    took = time.monotonic() - clock
    check(f"moveJ takes the time of its speeds ({took:.2f} s)", 0.85 < took < 3.0, took)
    check("moveJ arrives", apart(receive.getActualQ(), target) < 1e-3, receive.getActualQ())
    eventually("isSteady", control.isSteady)
    check("a target beyond the joints ends the script", control.moveJ([7.0] * 6, 1.0, 1.0) is False)
    eventually("the script ended", lambda: receive.getRuntimeState() == 1)
    upload_again(control)
    check("moveJ back", control.moveJ(start, 1.0, 2.0) and apart(receive.getActualQ(), start) < 1e-3)


def lines(control, receive):
    start = receive.getActualTCPPose()
    target = moved(start, [0.03, 0.12, -0.09, 0.0, 0.0, 0.0])
    path = []
    arrived = threading.Event()

    def record():
        path.extend(sampled(receive, lambda: not arrived.is_set(), receive.getActualTCPPose))

    recorder = threading.Thread(target=record)
    recorder.start()
    check("moveL returns True", control.moveL(target, 0.25, 0.8))
    arrived.set()
    recorder.join()
    check("moveL arrives", apart(receive.getActualTCPPose()[:3], target[:3]) < 1e-3, receive.getActualTCPPose())
    along = [b - a for a, b in zip(start[:3], target[:3], strict=True)]
    length = math.hypot(*along)

    def off(pose):
        step = [p - s for p, s in zip(pose[:3], start[:3], strict=True)]
        share = sum(a * s for a, s in zip(along, step, strict=True)) / length**2
        return math.dist(step, [share * a for a in along])

    worst = max(map(off, path))
    check(f"moveL is straight ({len(path)} samples, {worst * 1e3:.2f} mm off)", worst < 1.5e-3 and len(path) > 50)
    check("moveL back", control.moveL(start, 0.25, 0.8))


def asynchronous(control, receive):
    start = receive.getActualQ()
    target = moved(start, [1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    clock = time.monotonic()
    check("asynchronous moveJ returns at once", control.moveJ(target, 1.0, 2.0, True))
    took = time.monotonic() - clock
    check("... before the 2 s of the move", took < 1.0, took)
    eventually("it moves", lambda: abs(receive.getActualQd()[0]) > 0.5)
    check("its progress says so", control.getAsyncOperationProgress() >= 0, control.getAsyncOperationProgress())
    check("isSteady is False while it moves", not control.isSteady())
    control.stopJ(4.0)
    halted = receive.getActualQ()[0]
    check("stopJ stops early", start[0] + 0.05 < halted < target[0] - 0.5, halted)
    eventually("the arm stands", lambda: abs(receive.getActualQd()[0]) < 0.01)
    eventually("its progress says so", lambda: control.getAsyncOperationProgress() < 0)
    check("a new move replaces an asynchronous one", control.moveJ(target, 1.0, 2.0, True))
    time.sleep(0.3)
    check("moveJ during one", control.moveJ(start, 1.0, 2.0) and apart(receive.getActualQ(), start) < 1e-3)

    pose = receive.getActualTCPPose()
    away = moved(pose, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
    check("asynchronous moveL", control.moveL(away, 0.1, 0.5, True))
    eventually("it moves", lambda: math.hypot(*receive.getActualTCPSpeed()[:3]) > 0.08)
    control.stopL(1.0)
    gone = math.dist(receive.getActualTCPPose()[:3], pose[:3])
    check(f"stopL stops early ({gone * 1e3:.0f} mm)", 0.002 < gone < 0.15, gone)
    check("an asynchronous move is followed to its end", control.moveJ(start, 1.0, 2.0, True))
    eventually("its end is told", lambda: control.getAsyncOperationProgress() < 0)
    check("and it is there", apart(receive.getActualQ(), start) < 1e-3, receive.getActualQ())
    check("asynchronous stopJ", control.moveJ(target, 1.0, 2.0, True))
    time.sleep(0.4)
    control.stopJ(2.0, True)
    eventually("stops as well", lambda: abs(receive.getActualQd()[0]) < 0.01 and control.getAsyncOperationProgress() < 0)
    check("moveJ back", control.moveJ(start, 1.0, 2.0))


def kinematics(control, receive):
    joints, pose = receive.getTargetQ(), receive.getTargetTCPPose()
    forward = control.getForwardKinematics()
    check("getForwardKinematics is the pose of the TCP", apart(forward, pose) < 1e-6, forward)
    other = moved(joints, [0.1, -0.1, 0.1, 0.1, -0.1, 0.2])
    there = control.getForwardKinematics(other, control.getTCPOffset())
    back = control.getInverseKinematics(there, other)
    check("getInverseKinematics undoes it", apart(back, other) < 1e-6, back)
    check("getInverseKinematicsHasSolution", control.getInverseKinematicsHasSolution(there))
    far = [5.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    check("and not for a far pose", not control.getInverseKinematicsHasSolution(far))
    check("isPoseWithinSafetyLimits", control.isPoseWithinSafetyLimits(there))
    check("and not for a far pose", not control.isPoseWithinSafetyLimits(far))
    check("isJointsWithinSafetyLimits", control.isJointsWithinSafetyLimits(other))
    check("and not beyond the joints", not control.isJointsWithinSafetyLimits([9.0] * 6))
    turned = control.poseTrans([0.1, 0.2, 0.3, 0.0, 0.0, math.pi / 2], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    check("poseTrans", apart(turned, [0.1, 1.2, 0.3, 0.0, 0.0, math.pi / 2]) < 1e-9, turned)
    check("moveJ_IK", control.moveJ_IK(there, 1.0, 2.0) and apart(receive.getActualQ(), other) < 1e-3)
    check("moveL_FK", control.moveL_FK(joints, 0.25, 0.8) and apart(receive.getActualQ(), joints) < 1e-3)
    # The client does not wait for these two: the first answers are what the registers held before.
    eventually("getStepTime is 2 ms", lambda: abs(control.getStepTime() - 0.002) < 1e-9)
    flange = control.getForwardKinematics(receive.getTargetQ(), ALMOST_NOTHING)
    eventually("getActualToolFlangePose", lambda: apart(control.getActualToolFlangePose(), flange) < 1e-6)


def settings(control, receive):
    offset = control.getTCPOffset()
    tool = [0.01, 0.02, 0.12, 0.0, 0.1, 0.0]
    flange = control.getForwardKinematics(receive.getTargetQ(), ALMOST_NOTHING)
    check("setTcp", control.setTcp(tool))
    check("getTCPOffset gives it back", apart(control.getTCPOffset(), tool) < 1e-12, control.getTCPOffset())
    pose = control.poseTrans(flange, tool)
    eventually("the pose of the TCP follows", lambda: apart(receive.getTargetTCPPose(), pose) < 1e-6)
    check("setTcp back", control.setTcp(offset) and apart(control.getTCPOffset(), offset) < 1e-12)
    check("setPayload", control.setPayload(2.5, [0.01, 0.02, 0.03]))
    eventually("the payload is read back", lambda: abs(receive.getPayload() - 2.5) < 1e-12)
    check("its centre of gravity too", apart(receive.getPayloadCog(), [0.01, 0.02, 0.03]) < 1e-12)
    inertia = [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]
    check("setTargetPayload", control.setTargetPayload(1.5, [0.0, 0.0, 0.05], inertia))
    eventually("its inertia is read back", lambda: apart(receive.getPayloadInertia(), inertia) < 1e-12)


def signals(io, receive):
    before = receive.getActualDigitalOutputBits() & ~(1 << 3)
    check("io: standard output on", io.setStandardDigitalOut(3, True))
    eventually("seen by the receive interface", lambda: receive.getDigitalOutState(3))
    bits = receive.getActualDigitalOutputBits()
    check("others stay", bits == before | 1 << 3, bits)
    check("io: configurable output on", io.setConfigurableDigitalOut(2, True))
    eventually("seen", lambda: receive.getDigitalOutState(10))
    check("io: tool output on", io.setToolDigitalOut(1, True))
    eventually("seen", lambda: receive.getDigitalOutState(17))
    for signal in (io.setStandardDigitalOut(3, False), io.setConfigurableDigitalOut(2, False),
                   io.setToolDigitalOut(1, False)):
        check("io: off again", signal)
    eventually("seen", lambda: receive.getActualDigitalOutputBits() == before)
    check("io: analog output", io.setAnalogOutputVoltage(1, 0.5))
    eventually("seen in volts", lambda: abs(receive.getStandardAnalogOutput1() - 5.0) < 1e-9,
               seen=receive.getStandardAnalogOutput1)
    check("io: speed slider", io.setSpeedSlider(0.5))
    eventually("seen", lambda: abs(receive.getTargetSpeedFraction() - 0.5) < 1e-9)


def slowed(io, control, receive):
    start = receive.getActualQ()
    check("moveJ at half speed", control.moveJ(moved(start, [0.4, 0, 0, 0, 0, 0]), 1.0, 2.0, True))
    speeds = sampled(receive, lambda: control.getAsyncOperationProgress() >= 0, lambda: abs(receive.getActualQd()[0]))
    check("is half as fast", max(speeds) < 0.5, max(speeds))
    check("io: full speed", io.setSpeedSlider(1.0))
    eventually("seen", lambda: abs(receive.getTargetSpeedFraction() - 1.0) < 1e-9)
    check("moveJ back", control.moveJ(start, 1.0, 2.0))


def speeds(control, receive):
    start = receive.getActualQ()
    check("speedJ", control.speedJ([0.0, 0.0, 0.0, 0.0, 0.0, 0.5], 2.0))
    eventually("reaches its speed", lambda: abs(receive.getTargetQd()[5] - 0.5) < 1e-3)
    check("speedStop", control.speedStop(5.0))
    eventually("stops", lambda: abs(receive.getTargetQd()[5]) < 1e-9)
    pose = receive.getTargetTCPPose()
    check("speedL", control.speedL([0.0, 0.05, 0.0, 0.0, 0.0, 0.0], 0.5))
    eventually("reaches its speed", lambda: abs(receive.getTargetTCPSpeed()[1] - 0.05) < 1e-3)
    time.sleep(0.3)
    check("speedStop", control.speedStop(1.0))
    gone = [a - b for a, b in zip(receive.getTargetTCPPose(), pose, strict=True)]
    check("in its direction only", gone[1] > 0.01 and max(abs(gone[0]), abs(gone[2])) < 1e-3, gone)
    check("jogStart", control.jogStart([0.0, 0.0, 0.03, 0.0, 0.0, 0.0], RTDEControlInterface.FEATURE_BASE))
    eventually("jogs", lambda: receive.getTargetTCPSpeed()[2] > 0.02)
    check("jogStop", control.jogStop())
    eventually("stops", lambda: max(map(abs, receive.getTargetQd())) < 1e-9)
    target = receive.getTargetQ()
    for step in range(200):
        cycle = control.initPeriod()
        target[0] += 0.0005
        if not control.servoJ(target, 0.0, 0.0, 0.002, 0.1, 300):
            check("servoJ", False, f"step {step}")
        control.waitPeriod(cycle)
    eventually("servoJ gets there", lambda: abs(receive.getActualQ()[0] - target[0]) < 2e-3)
    check("servoStop", control.servoStop())
    check("moveJ back", control.moveJ(start, 1.0, 2.0) and apart(receive.getActualQ(), start) < 1e-3)


def paths(control, receive):
    start = receive.getActualQ()
    side = moved(start, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    ways = [[*side, 1.0, 2.0, 0.02], [*start, 1.0, 2.0, 0.0]]
    reached = []
    recorder = threading.Thread(
        target=lambda: reached.extend(sampled(receive, lambda: not reached_end.is_set(), lambda: receive.getActualQ()[0]))
    )
    reached_end = threading.Event()
    recorder.start()
    check("moveJ along a path", control.moveJ(ways))
    reached_end.set()
    recorder.join()
    check("goes there and comes back", max(reached) > side[0] - 0.05 and apart(receive.getActualQ(), start) < 1e-3)
    path = Path()
    path.addEntry(PathEntry(PathEntry.MoveJ, PathEntry.PositionJoints, [*side, 1.0, 2.0, 0.0]))
    path.addEntry(PathEntry(PathEntry.MoveJ, PathEntry.PositionJoints, [*start, 1.0, 2.0, 0.0]))
    check("movePath", control.movePath(path) and apart(receive.getActualQ(), start) < 1e-3)


def several(host, control, receive):
    others = [RTDEReceiveInterface(host, 100.0) for _ in range(3)]
    taken = refused(lambda: RTDEControlInterface(host))
    check("a second control client finds its inputs taken", taken is not None and "in use" in taken, taken)
    lookers = [DashboardClient(host) for _ in range(3)]
    for looker in lookers:
        looker.connect()
    check("several dashboards", [looker.running() for looker in lookers] == [True] * 3)
    start = receive.getActualQ()
    check("moveJ meanwhile", control.moveJ(moved(start, [0.1, 0, 0, 0, 0, 0]), 1.0, 2.0))
    check("all see the same", all(apart(o.getActualQ(), receive.getActualQ()) < 1e-3 for o in others))
    check("moveJ back", control.moveJ(start, 1.0, 2.0))
    for other in others:
        other.disconnect()
    for looker in lookers:
        looker.quit()
    check("nobody minds that they go", receive.isConnected() and control.isSteady() is not None)


def own_scripts(control, receive):
    done = control.sendCustomScriptFunction("outputs", "set_standard_digital_out(5, True)\nsleep(0.1)\n")
    check("a script of the user's own runs", done)
    eventually("and does what it says", lambda: receive.getDigitalOutState(5))
    upload_again(control)
    check("what is not simulated is no silent success", control.forceMode(
        [0.0] * 6, [0, 0, 1, 0, 0, 0], [0.0, 0.0, 5.0, 0.0, 0.0, 0.0], 2, [0.1] * 6))
    eventually("the script ends", lambda: receive.getRuntimeState() == 1)
    # This also clears the command, which the next script would carry out again.
    check("a move then is refused", control.moveJ(receive.getActualQ(), 1.0, 1.0) is False)
    upload_again(control)


def watchdog(control, receive):
    check("setWatchdog", control.setWatchdog(10.0))
    for _ in range(50):
        control.kickWatchdog()
        time.sleep(0.02)
    check("kicks keep the program alive", control.isProgramRunning())
    eventually("without kicks it stops", lambda: receive.getRuntimeState() == 1, 0.5)
    check("a move then is refused", control.moveJ(receive.getActualQ(), 1.0, 1.0) is False)
    upload_again(control)


def stop_and_reconnect(control, receive):
    control.stopScript()
    eventually("stopScript ends the program", lambda: receive.getRuntimeState() == 1)
    check("a move then is refused", control.moveJ(receive.getActualQ(), 1.0, 1.0) is False)
    control.disconnect()
    check("disconnect", not control.isConnected())
    check("reconnect", control.reconnect() and control.isConnected() and control.isProgramRunning())
    check("moveJ again", control.moveJ(moved(receive.getActualQ(), [0.0, 0.0, 0.0, 0.0, 0.0, 0.1]), 1.0, 2.0))
    receive.disconnect()
    check("the receive interface reconnects", receive.reconnect() and receive.getRobotMode() == RUNNING)


def protective_stop(control, receive, dashboard):
    start = receive.getActualQ()
    check("asynchronous moveJ", control.moveJ(moved(start, [1.0, 0, 0, 0, 0, 0]), 1.0, 2.0, True))
    time.sleep(0.5)
    control.triggerProtectiveStop()
    eventually("a protective stop is seen", receive.isProtectiveStopped)
    clock = time.monotonic()
    check("as safety mode 3", receive.getSafetyMode() == 3, receive.getSafetyMode())
    check("by the dashboard too", dashboard.safetystatus() == "Safetystatus: PROTECTIVE_STOP", dashboard.safetystatus())
    eventually("the arm stands", lambda: max(map(abs, receive.getActualQd())) < 0.01)
    eventually("the program pauses", lambda: receive.getRuntimeState() == 4)
    check("a move then is refused", control.moveJ(start, 1.0, 2.0) is False)
    early = refused(dashboard.unlockProtectiveStop)
    check("unlocking at once is refused", early is not None and "until 5s after" in early, early)
    time.sleep(max(0.0, 5.2 - (time.monotonic() - clock)))
    dashboard.unlockProtectiveStop()
    eventually("unlocked after 5 s", lambda: receive.getSafetyMode() == 1)
    dashboard.stop()
    eventually("the paused program is stopped", lambda: receive.getRuntimeState() == 1)
    upload_again(control)
    check("moveJ back", control.moveJ(start, 1.0, 2.0) and apart(receive.getActualQ(), start) < 1e-3)


def main(host):
    print(f"ur-rtde {version('ur-rtde')} against {host}", flush=True)
    faulthandler.dump_traceback_later(LIMIT_S, exit=True)
    receive = RTDEReceiveInterface(host)
    reading(receive)
    dashboard = DashboardClient(host)
    dashboard.connect()
    dashboard.stop()
    eventually("what an earlier client left is stopped", lambda: receive.getRuntimeState() == 1)
    questions(dashboard)
    programs(dashboard, receive)
    power(dashboard, receive)
    io = RTDEIOInterface(host)
    signals(io, receive)
    clock = time.monotonic()
    control = RTDEControlInterface(host)
    check(f"the control script runs ({time.monotonic() - clock:.3f} s)", control.isProgramRunning())
    slowed(io, control, receive)
    joint_moves(control, receive)
    lines(control, receive)
    asynchronous(control, receive)
    kinematics(control, receive)
    settings(control, receive)
    speeds(control, receive)
    paths(control, receive)
    several(host, control, receive)
    own_scripts(control, receive)
    watchdog(control, receive)
    stop_and_reconnect(control, receive)
    protective_stop(control, receive, dashboard)
    control.stopScript()
    eventually("the end", lambda: receive.getRuntimeState() == 1)
    for client in (control, io, receive):
        client.disconnect()
    dashboard.quit()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
