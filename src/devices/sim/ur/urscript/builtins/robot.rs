//! The robot's settings, its safety, and the watchdog.

use super::{Arguments, Builtin, nothing, numbers, value};
use crate::devices::sim::ur::body::{Body, Watchdog, WatchdogAction};
use crate::devices::sim::ur::motion::TICK_S;
use crate::devices::sim::ur::outputs::JOINT_TEMPERATURE_C;
use crate::devices::sim::ur::urscript::value::Value;

/// Heaviest payload, kg; far above what a UR5e carries, for programs of its larger sisters.
const MAX_PAYLOAD_KG: f64 = 50.0;

pub(super) const TABLE: &[Builtin] = &[
    value("get_steptime", &[], |_, _| Ok(Value::Float(TICK_S))),
    value("set_tcp", &["pose", "tcp_name"], |b, a| {
        b.set_tcp_offset(a.need(0)?.six()?);
        nothing()
    }),
    value("get_tcp_offset", &[], |b, _| Ok(Value::Pose(b.config.tcp_offset))),
    value("set_payload", &["m", "cog"], set_payload),
    value("set_payload_mass", &["m"], set_payload),
    value("set_payload_cog", &["CoG"], |b, a| {
        b.config.payload_cog_m = a.three(0)?;
        nothing()
    }),
    value("set_target_payload", &["m", "cog", "inertia", "transition_time"], set_payload),
    value("get_target_payload", &[], |b, _| Ok(Value::Float(b.config.payload_kg))),
    value("get_target_payload_cog", &[], |b, _| Ok(numbers(&b.config.payload_cog_m))),
    value("get_target_payload_inertia", &[], |b, _| Ok(numbers(&b.payload_inertia_kg_m2))),
    value("set_gravity", &["d"], |_, a| a.three(0).map(|_| Value::Nothing)),
    value("get_joint_temp", &["j"], |_, a| a.below(0, 6).map(|_| Value::Float(JOINT_TEMPERATURE_C))),
    value("get_joint_torques", &[], |_, _| Ok(numbers(&[0.0; 6]))),
    value("get_tcp_force", &[], |_, _| Ok(numbers(&[0.0; 6]))),
    value("force", &[], |_, _| Ok(Value::Float(0.0))),
    value("zero_ftsensor", &[], |_, _| nothing()),
    // There is nothing to touch.
    value("tool_contact", &["direction"], |_, _| Ok(Value::Int(0))),
    // Settings of modes that are refused themselves.
    value("force_mode_set_damping", &["damping"], |_, a| a.number(0).map(|_| Value::Nothing)),
    value("force_mode_set_gain_scaling", &["scaling"], |_, a| a.number(0).map(|_| Value::Nothing)),
    value("end_force_mode", &[], |_, _| nothing()),
    value("end_teach_mode", &[], |_, _| nothing()),
    value("end_freedrive_mode", &[], |_, _| nothing()),
    value("get_freedrive_status", &[], |_, _| Ok(Value::Int(0))),
    value("protective_stop", &[], |b, _| {
        b.protective_stop("asked for by the program");
        nothing()
    }),
    value("rtde_set_watchdog", &["variable_name", "min_frequency", "action"], set_watchdog),
];

fn set_payload(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let mass_kg = arguments.number(0)?;
    let fine = (0.0..=MAX_PAYLOAD_KG).contains(&mass_kg);
    if !fine {
        return Err(format!("`{}`: {mass_kg} kg is not from 0 to {MAX_PAYLOAD_KG}", arguments.name));
    }
    if arguments.get(1).is_some() {
        body.config.payload_cog_m = arguments.three(1)?;
    }
    if let Some(inertia) = arguments.get(2) {
        body.payload_inertia_kg_m2 = inertia.six()?;
    }
    body.config.payload_kg = mass_kg;
    nothing()
}

fn set_watchdog(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let variable = arguments.text(0)?;
    let slot = body.inputs.find(&variable).ok_or_else(|| format!("`{variable}` is not an RTDE input"))?;
    let frequency_hz = arguments.positive(1, 10.0)?;
    let action = match arguments.get(2).map(Value::text).as_deref() {
        Some("ignore") => WatchdogAction::Ignore,
        None | Some("pause") => WatchdogAction::Pause,
        Some("stop") => WatchdogAction::Stop,
        Some(other) => return Err(format!("`{other}` is not a watchdog action")),
    };
    let period_ticks = Body::ticks_of(1.0 / frequency_hz);
    body.watchdogs.retain(|w| w.slot != slot);
    body.watchdogs.push(Watchdog { slot, period_ticks, since_tick: body.tick, action });
    Ok(Value::Bool(true))
}
