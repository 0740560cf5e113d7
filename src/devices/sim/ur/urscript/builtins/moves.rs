//! What moves the arm, and what waits.

use super::{Arguments, Builtin, Call, moves, value, waits};
use crate::devices::sim::ur::body::Body;
use crate::devices::sim::ur::motion::{self, Goal, TICK_S};
use crate::devices::sim::ur::urscript::value::Value;
use crate::geometry::kinematics::Joints;

/// Longest time that one call may take, s.
const MAX_WAIT_S: f64 = 1e6;

pub(super) const TABLE: &[Builtin] = &[
    waits("sync", &[], |_, _| Ok(Call::Ticks(1))),
    waits("sleep", &["t"], |_, a| a.number(0).map(ticks)),
    begins_at_rest("movej", &["q", "a", "v", "t", "r"], start_move),
    begins_at_rest("movel", &["pose", "a", "v", "t", "r"], start_move),
    moves("stopj", &["a"], stop),
    moves("stopl", &["a", "aRot"], stop),
    moves("speedj", &["qd", "a", "t"], speed),
    moves("speedl", &["xd", "a", "t", "aRot"], speed),
    moves("servoj", &["q", "a", "v", "t", "lookahead_time", "gain"], servo),
    value("is_steady", &[], |b, _| Ok(Value::Bool(b.motion.is_steady()))),
    value("is_within_safety_limits", &["pose"], |b, a| Ok(Value::Bool(is_within_limits(b, a.need(0)?)))),
];

const fn begins_at_rest(name: &'static str, parameters: &'static [&'static str], function: super::Function) -> Builtin {
    Builtin { begins_at_rest: true, ..moves(name, parameters, function) }
}

fn ticks(seconds: f64) -> Call {
    // What is not a number counts as no time.
    Call::Ticks((seconds.clamp(0.0, MAX_WAIT_S) / TICK_S).round() as u64)
}

/// Joint positions of a target given as a pose or as joint positions.
fn joints_of(body: &Body, target: &Value) -> Result<Joints, String> {
    match target {
        Value::Pose(pose) => {
            let near = body.motion.target();
            body.motion.joints_for(*pose, &near).ok_or_else(|| "no inverse kinematics: out of reach".to_owned())
        }
        other => other.six(),
    }
}

fn is_within_limits(body: &Body, target: &Value) -> bool {
    joints_of(body, target).is_ok_and(|joints| body.is_within_limits(&joints))
}

fn start_move(body: &mut Body, arguments: &Arguments<'_>) -> Result<Call, String> {
    let joints = joints_of(body, arguments.need(0)?)?;
    if !body.is_within_limits(&joints) {
        return Err(format!("`{}`: the target is outside the safety limits", arguments.name));
    }
    let line = arguments.name == "movel";
    let (acceleration, speed) = if line { (1.2, 0.25) } else { (1.4, 1.05) };
    let (acceleration, speed) = (arguments.positive(1, acceleration)?, arguments.positive(2, speed)?);
    let time_s = arguments.number_or(3, 0.0)?;
    if time_s > 0.0 {
        body.motion.start_timed(joints, line, time_s);
    } else if line {
        body.motion.start_line(&joints, speed, acceleration);
    } else {
        body.motion.start_joint_move(joints, speed.min(std::f64::consts::PI), acceleration);
    }
    Ok(Call::UntilAtRest)
}

fn stop(body: &mut Body, arguments: &Arguments<'_>) -> Result<Call, String> {
    let given = arguments.positive(0, 2.0)?;
    let speeds = body.motion.target_speed();
    let deceleration_rad_s2 = if arguments.name == "stopj" {
        given
    } else {
        // In m/s2: scaled to the leading joint by the speeds of now.
        let [x, y, z, ..] = body.motion.tcp_speed(&body.motion.target(), &speeds);
        let tcp_speed_m_s = (x * x + y * y + z * z).sqrt().max(1e-3);
        given * motion::largest(&speeds) / tcp_speed_m_s
    };
    if body.motion.is_busy() {
        body.motion.stop(deceleration_rad_s2);
    }
    Ok(Call::UntilAtRest)
}

fn speed(body: &mut Body, arguments: &Arguments<'_>) -> Result<Call, String> {
    let speeds = arguments.need(0)?.six()?;
    let joint = arguments.name == "speedj";
    let acceleration = arguments.positive(1, if joint { 1.4 } else { 1.2 })?;
    let goal = if joint { Goal::JointSpeed(speeds) } else { Goal::TcpSpeed(speeds) };
    body.motion.start_speed(goal, acceleration);
    let time_s = arguments.number_or(2, 0.0)?;
    Ok(if time_s > 0.0 { ticks(time_s) } else { Call::UntilSpeedReached })
}

fn servo(body: &mut Body, arguments: &Arguments<'_>) -> Result<Call, String> {
    let joints = arguments.need(0)?.six()?;
    if !body.is_within_limits(&joints) {
        return Err("`servoj`: the target is outside the safety limits".into());
    }
    let lookahead_s = arguments.number_or(4, 0.1)?.clamp(0.03, 0.2);
    body.motion.start_speed(Goal::Position { joints, lookahead_s }, motion::SERVO_RAD_S2);
    Ok(ticks(arguments.number_or(3, TICK_S)?.max(TICK_S)))
}
