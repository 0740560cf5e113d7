//! Names of the modes that a UR controller reports.

/// Name of a robot mode, with its number.
pub fn robot_mode_name(mode: i32) -> String {
    let names = [
        "NO_CONTROLLER",
        "DISCONNECTED",
        "CONFIRM_SAFETY",
        "BOOTING",
        "POWER_OFF",
        "POWER_ON",
        "IDLE",
        "BACKDRIVE",
        "RUNNING",
        "UPDATING_FIRMWARE",
    ];
    named(mode, usize::try_from(mode.wrapping_add(1)).ok().and_then(|i| names.get(i)))
}

/// Name of a safety mode, with its number; an unknown one is not safe.
pub fn safety_mode_name(mode: i32) -> String {
    let names = [
        "NORMAL",
        "REDUCED",
        "PROTECTIVE_STOP",
        "RECOVERY",
        "SAFEGUARD_STOP",
        "SYSTEM_EMERGENCY_STOP",
        "ROBOT_EMERGENCY_STOP",
        "VIOLATION",
        "FAULT",
        "VALIDATE_JOINT_ID",
        "UNDEFINED",
        "AUTOMATIC_MODE_SAFEGUARD_STOP",
        "SYSTEM_THREE_POSITION_ENABLING_STOP",
        "TP_THREE_POSITION_ENABLING_STOP",
        "IMMI_EMERGENCY_STOP",
        "IMMI_SAFEGUARD_STOP",
        "PROFISAFE_WAITING_FOR_PARAMETERS",
        "PROFISAFE_AUTOMATIC_MODE_SAFEGUARD_STOP",
        "PROFISAFE_SAFEGUARD_STOP",
        "PROFISAFE_EMERGENCY_STOP",
    ];
    let name = match mode {
        22 => Some(&"SAFETY_API_SAFEGUARD_STOP"),
        _ => usize::try_from(mode.wrapping_sub(1)).ok().and_then(|i| names.get(i)),
    };
    named(mode, name)
}

/// Name of a runtime state, with its number.
pub fn runtime_state_name(state: u32) -> String {
    let names = ["STOPPING", "STOPPED", "PLAYING", "PAUSING", "PAUSED", "RESUMING"];
    let name = usize::try_from(state).ok().and_then(|i| names.get(i));
    named(i32::try_from(state).unwrap_or(-1), name)
}

fn named(number: i32, name: Option<&&str>) -> String {
    name.map_or_else(|| format!("{number} (unknown)"), |name| format!("{number} ({name})"))
}
