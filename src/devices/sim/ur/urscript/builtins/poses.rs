//! Poses, kinematics, and where the arm is.

use super::{Arguments, Builtin, numbers, value};
use crate::devices::sim::ur::body::Body;
use crate::devices::sim::ur::urscript::value::Value;
use crate::geometry::{Base, Flange, Tcp, Transform, kinematics::Joints, rotation};

/// Any frames: what a program calls a pose carries none.
type Pose = Transform<Base, Base>;

pub(super) const TABLE: &[Builtin] = &[
    value("get_actual_tcp_pose", &[], tcp_pose),
    value("get_target_tcp_pose", &[], tcp_pose),
    value("get_actual_tool_flange_pose", &[], |b, _| Ok(Value::Pose(b.motion.base_from_flange().pose_vector()))),
    value("get_actual_joint_positions", &[], joints),
    value("get_target_joint_positions", &[], joints),
    value("get_actual_joint_speeds", &[], |b, _| Ok(numbers(&b.motion.target_speed()))),
    value("get_target_joint_speeds", &[], |b, _| Ok(numbers(&b.motion.target_speed()))),
    value("get_actual_tcp_speed", &[], tcp_speed),
    value("get_target_tcp_speed", &[], tcp_speed),
    value("get_target_waypoint", &[], |b, _| Ok(Value::Pose(b.motion.waypoint().pose_vector()))),
    value("get_forward_kin", &["q", "tcp"], forward),
    value("get_inverse_kin", &["x", "qnear", "maxPositionError", "maxOrientationError", "tcp"], inverse),
    value(
        "get_inverse_kin_has_solution",
        &["pose", "qnear", "maxPositionError", "maxOrientationError", "tcp"],
        |b, a| Ok(Value::Bool(solve(b, a)?.is_some())),
    ),
    value("pose_trans", &["p_from", "p_from_to"], |_, a| made(pose(a, 0)? * pose(a, 1)?)),
    value("pose_inv", &["p_from"], |_, a| made(pose(a, 0)?.inverse())),
    value("pose_add", &["p_1", "p_2"], |_, a| combined(pose(a, 0)?, pose(a, 1)?, 1.0)),
    value("pose_sub", &["p_to", "p_from"], |_, a| combined(pose(a, 1)?, pose(a, 0)?, -1.0)),
    value("pose_dist", &["p_from", "p_to"], distance),
    value("point_dist", &["p_from", "p_to"], distance),
    value("interpolate_pose", &["p_from", "p_to", "alpha"], |_, a| {
        made(pose(a, 0)?.interpolate(&pose(a, 1)?, a.number(2)?))
    }),
    value("rpy2rotvec", &["rpy_vector"], |_, a| {
        let [roll, pitch, yaw] = a.three(0)?;
        Ok(numbers(rotation::to_vector(&nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw)).as_slice()))
    }),
    value("rotvec2rpy", &["rotation_vector"], |_, a| {
        let (roll, pitch, yaw) = rotation::from_vector(a.three(0)?).euler_angles();
        Ok(numbers(&[roll, pitch, yaw]))
    }),
];

fn tcp_pose(body: &mut Body, _: &Arguments<'_>) -> Result<Value, String> {
    Ok(Value::Pose(body.motion.base_from_tcp(&body.motion.target()).pose_vector()))
}

fn joints(body: &mut Body, _: &Arguments<'_>) -> Result<Value, String> {
    Ok(numbers(&body.motion.target()))
}

fn tcp_speed(body: &mut Body, _: &Arguments<'_>) -> Result<Value, String> {
    Ok(numbers(&body.motion.tcp_speed(&body.motion.target(), &body.motion.target_speed())))
}

fn pose(arguments: &Arguments<'_>, index: usize) -> Result<Pose, String> {
    let pose = Pose::from_pose_vector(arguments.need(index)?.six()?);
    if pose.is_finite() { Ok(pose) } else { Err(format!("`{}`: a pose is not finite", arguments.name)) }
}

fn made(pose: Pose) -> Result<Value, String> {
    Ok(Value::Pose(pose.pose_vector()))
}

/// Positions added, rotations chained; with a sign of -1 what leads from `first` to `second`.
fn combined(first: Pose, second: Pose, sign: f64) -> Result<Value, String> {
    let (a, b) = (first.translation_m(), second.translation_m());
    let turned = if sign < 0.0 { first.rotation().inverse() } else { first.rotation() } * second.rotation();
    made(Pose::from_parts(std::array::from_fn(|i| b[i] + sign * a[i]), turned))
}

fn distance(_: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    Ok(Value::Float(pose(arguments, 0)?.distance_to_m(&pose(arguments, 1)?)))
}

fn flange_from_tcp(arguments: &Arguments<'_>, index: usize) -> Result<Option<Transform<Flange, Tcp>>, String> {
    arguments.get(index).map(|tcp| tcp.six().map(Transform::from_pose_vector)).transpose()
}

fn forward(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let joints = arguments.get(0).map_or(Ok(body.motion.target()), Value::six)?;
    let base_from_tcp = match flange_from_tcp(arguments, 1)? {
        Some(tcp) => body.motion.arm().forward(&joints) * tcp,
        None => body.motion.base_from_tcp(&joints),
    };
    Ok(Value::Pose(base_from_tcp.pose_vector()))
}

fn solve(body: &Body, arguments: &Arguments<'_>) -> Result<Option<Joints>, String> {
    let near = arguments.get(1).map_or(Ok(body.motion.target()), Value::six)?;
    let wanted = arguments.need(0)?.six()?;
    Ok(match flange_from_tcp(arguments, 4)? {
        Some(tcp) => {
            let base_from_flange = Transform::<Base, Tcp>::from_pose_vector(wanted) * tcp.inverse();
            let finite = base_from_flange.is_finite();
            finite.then(|| body.motion.arm().inverse(&base_from_flange, &near).ok()).flatten()
        }
        None => body.motion.joints_for(wanted, &near),
    })
}

fn inverse(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let joints = solve(body, arguments)?.ok_or_else(|| "get_inverse_kin: out of reach".to_owned())?;
    Ok(numbers(&joints))
}
