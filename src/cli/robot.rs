//! `cellcal robot`: looks at a controller without touching it.
//!
//! Everything here only receives: no input is claimed, no script is sent, nothing moves.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::exit::UsageError;
use super::progress::say;
use super::session::interrupts;
use super::teach::put;
use super::{Exit, print, read_text};
use crate::config::{self, Cell, RobotDriver};
use crate::devices::ur::{RobotInfo, UrConfig, UrMonitor, read_kinematics};
use crate::devices::{Clock, WallClock};
use crate::geometry::kinematics::{Dh, Joints};
use crate::geometry::{Base, Flange, Tcp, Transform};
use crate::runner::setup::expected_of;
use crate::session::{
    self, Finding, Kinematics, RobotFacts, RobotSample, Stamp, robot_mode_name, runtime_state_name, safety_mode_name,
};

/// Version of the JSON that is printed here.
const SCHEMA_VERSION: u32 = 1;
/// Time between two states of `--watch`, s.
const WATCH_S: f64 = 1.0;

/// Looks at a robot without touching it.
#[derive(Debug, Subcommand)]
pub(super) enum Robot {
    /// Shows what the controller reports and, with a cell, what pre-flight would refuse (exit code 6).
    Status(Status),
    /// Shows the calibrated kinematics, and the checksum for the cell file.
    Kinematics(ShowKinematics),
    /// Writes the calibrated arm as URDF.
    Urdf(Urdf),
}

impl Robot {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        match self {
            Self::Status(command) => command.execute(),
            Self::Kinematics(command) => command.execute(),
            Self::Urdf(command) => command.execute(),
        }
    }
}

/// Where the controller is, if not where the cell says or at the usual ports.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct Address {
    /// Host of the controller, instead of the cell's; also that of a simulator.
    #[arg(long, value_name = "HOST")]
    pub(super) address: Option<String>,
    /// Port of RTDE. Default: 30004.
    #[arg(long, value_name = "PORT")]
    pub(super) rtde_port: Option<u16>,
    /// Port of the primary interface. Default: 30001.
    #[arg(long, value_name = "PORT")]
    pub(super) primary_port: Option<u16>,
    /// Port of the dashboard. Default: 29999.
    #[arg(long, value_name = "PORT")]
    pub(super) dashboard_port: Option<u16>,
}

impl Address {
    /// How to reach the controller of this cell, or the one at `--address`.
    pub(super) fn config(&self, cell: Option<&Cell>) -> Result<UrConfig, UsageError> {
        let of_cell = cell.filter(|c| c.robot.driver == RobotDriver::Ur).and_then(|c| c.robot.address.clone());
        let Some(host) = self.address.clone().or(of_cell) else {
            let why =
                if cell.is_some() { "the cell has `driver: sim`: give" } else { "give a cell with `driver: ur`, or" };
            return Err(UsageError(format!("no controller to connect to; {why} --address HOST")));
        };
        let usual = cell.map_or_else(|| UrConfig::at(&host), |cell| UrConfig::of_cell(cell, &host));
        Ok(UrConfig {
            rtde_port: self.rtde_port.unwrap_or(usual.rtde_port),
            primary_port: self.primary_port.unwrap_or(usual.primary_port),
            dashboard_port: self.dashboard_port.or(usual.dashboard_port),
            ..usual
        })
    }
}

/// A cell file alone, without its trajectories.
pub(super) fn load_cell(path: &Path) -> anyhow::Result<Cell> {
    Ok(config::parse_cell(&read_text(path)?, &path.display().to_string())?)
}

/// Time since now, as drivers want it.
pub(super) fn wall_clock() -> Arc<dyn Clock> {
    Arc::new(WallClock::starting_at(Stamp(0)))
}

/// Everything that pre-flight would refuse now, or ask the operator about.
pub(super) fn preflight_findings(cell: &Cell, facts: &RobotFacts, sample: &RobotSample) -> Vec<Finding> {
    let expected = expected_of(cell);
    let mut found = session::preflight_findings(facts, sample, &expected);
    found.extend(session::start_finding(sample, &expected));
    found
}

/// The state of a robot.
#[derive(Debug, Args)]
pub(super) struct Status {
    /// The cell whose robot it is, and whose expectations it is held against.
    cell: Option<PathBuf>,
    #[command(flatten)]
    at: Address,
    /// As JSON; with --watch one line each.
    #[arg(long)]
    json: bool,
    /// Once a second, until Ctrl-C.
    #[arg(long)]
    watch: bool,
}

impl Status {
    fn execute(self) -> anyhow::Result<Exit> {
        let cell = self.cell.as_deref().map(load_cell).transpose()?;
        let config = self.at.config(cell.as_ref())?;
        let mut monitor = UrMonitor::connect(&config, wall_clock())?;
        let wanted = cell.as_ref().is_some_and(|c| c.robot.kinematics_checksum.is_some());
        let kinematics = if wanted { Some(read_kinematics(&config)?) } else { None };
        let seen = Seen::now(&mut monitor, kinematics.as_ref(), cell.as_ref())?.1;
        if !self.watch {
            self.show(&seen)?;
            return Ok(seen.exit());
        }
        let interrupted = interrupts()?;
        let mut shown = None;
        while !interrupted.load(Ordering::Relaxed) {
            let (at, seen) = Seen::now(&mut monitor, kinematics.as_ref(), cell.as_ref())?;
            if shown.is_none_or(|last: Stamp| at.seconds() - last.seconds() >= WATCH_S) {
                self.show(&seen)?;
                monitor.refresh_info();
                shown = Some(at);
            }
        }
        Ok(Exit::Interrupted)
    }

    fn show(&self, seen: &Seen) -> anyhow::Result<()> {
        match (self.json, self.watch) {
            (true, true) => print(&format!("{}\n", seen.json())),
            (true, false) => print(&format!("{}\n", serde_json::to_string_pretty(&seen.json())?)),
            (false, true) => print(&format!("{}\n", seen.text())),
            (false, false) => print(&seen.text()),
        }
    }
}

/// What a controller reports at one instant.
#[derive(Debug)]
struct Seen {
    facts: RobotFacts,
    info: RobotInfo,
    sample: RobotSample,
    /// Absent without a cell.
    findings: Option<Vec<Finding>>,
}

impl Seen {
    fn now(
        monitor: &mut UrMonitor,
        kinematics: Option<&Kinematics>,
        cell: Option<&Cell>,
    ) -> anyhow::Result<(Stamp, Self)> {
        let (at, sample) = monitor.next_sample()?;
        let facts = monitor.facts(kinematics.cloned());
        let findings = cell.map(|cell| preflight_findings(cell, &facts, &sample));
        Ok((at, Self { facts, info: monitor.robot_info().clone(), sample, findings }))
    }

    fn exit(&self) -> Exit {
        let refused = self.findings.as_ref().is_some_and(|f| !f.is_empty());
        if refused { Exit::PreflightFailed } else { Exit::Ok }
    }

    fn json(&self) -> Value {
        let Self { facts, info, sample, findings } = self;
        let mut seen = json!({
            "schema_version": SCHEMA_VERSION,
            "controller_version": facts.controller_version.map(|n| n.to_string()).join("."),
            "controller_time_s": sample.controller_time_s,
            "robot_mode": sample.robot_mode, "robot_mode_name": robot_mode_name(sample.robot_mode),
            "safety_mode": sample.safety_mode, "safety_mode_name": safety_mode_name(sample.safety_mode),
            "safety_status": safety_words(sample.safety_status_bits),
            "teach_button": sample.robot_status_bits >> 2 & 1 == 1,
            "program_state": sample.runtime_state, "program_state_name": runtime_state_name(sample.runtime_state),
            "speed_slider": sample.target_speed_fraction, "speed_scaling": sample.speed_scaling,
            "payload_kg": sample.payload_kg, "payload_cog_m": sample.payload_cog_m,
            "tcp_offset": sample.tcp_offset, "tcp_pose": sample.tcp_pose,
            "joints_rad": sample.joints_rad, "joint_temperatures_c": sample.joint_temperatures_c,
            "digital_inputs_on": bits_on(sample.digital_inputs), "digital_outputs_on": bits_on(sample.digital_outputs),
        });
        // What is not known is absent, never null.
        let known = [
            ("model", facts.model.as_ref().map(|v| json!(v))),
            ("serial", facts.serial.as_ref().map(|v| json!(v))),
            ("software", info.polyscope_version.as_ref().map(|v| json!(v))),
            ("remote_control", facts.remote_control.map(|v| json!(v))),
            ("preflight", findings.as_ref().map(|v| json!(v))),
        ];
        for (key, value) in known.into_iter().filter_map(|(key, value)| Some((key, value?))) {
            seen[key] = value;
        }
        seen
    }

    fn text(&self) -> String {
        let Self { facts, info, sample, findings } = self;
        let known = |v: &Option<String>| v.clone().unwrap_or_else(|| "not told".into());
        let remote = facts.remote_control.map_or("not told", |on| if on { "yes" } else { "no, local control" });
        let version = || facts.controller_version.map(|n| n.to_string()).join(".");
        let software = info.polyscope_version.clone().unwrap_or_else(version);
        let cog_mm = sample.payload_cog_m.map(|v| format!("{:.1}", v * 1e3)).join(", ");
        let degrees = sample.joints_rad.map(|q| format!("{:8.3}", q.to_degrees())).join(" ");
        let warmth = sample.joint_temperatures_c.map(|t| format!("{t:8.1}")).join(" ");
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let teach = if sample.robot_status_bits >> 2 & 1 == 1 { ", teach button pressed" } else { "" };
        let rows = [
            ("controller", format!("{software}, on for {:.0} s", sample.controller_time_s)),
            ("robot", format!("model {}, serial {}", known(&facts.model), known(&facts.serial))),
            ("remote", remote.into()),
            ("mode", format!("{}{teach}", robot_mode_name(sample.robot_mode))),
            (
                "safety",
                format!(
                    "{}: {}",
                    safety_mode_name(sample.safety_mode),
                    safety_words(sample.safety_status_bits).join(", ")
                ),
            ),
            ("program", runtime_state_name(sample.runtime_state)),
            (
                "speed",
                format!(
                    "slider {}, in effect {}",
                    percent(sample.target_speed_fraction),
                    percent(sample.speed_scaling)
                ),
            ),
            ("payload", format!("{:.3} kg at ({cog_mm}) mm in the flange", sample.payload_kg)),
            ("TCP offset", pose_words(&Transform::<Flange, Tcp>::from_pose_vector(sample.tcp_offset))),
            ("TCP", pose_words(&sample.base_from_tcp())),
            ("joints", format!("{degrees} deg")),
            ("warmth", format!("{warmth} C")),
            ("inputs on", numbers(&bits_on(sample.digital_inputs))),
            ("outputs on", numbers(&bits_on(sample.digital_outputs))),
        ];
        let mut text: String = rows.iter().map(|(name, value)| format!("{name:<11} {value}\n")).collect();
        match findings.as_deref() {
            None => {}
            Some([]) => text.push_str("pre-flight  would let it move, from its home\n"),
            Some(found) => {
                text.push_str("pre-flight  would refuse:\n");
                text.extend(found.iter().map(|f| format!("  {f}\n")));
            }
        }
        text
    }
}

/// A pose in mm and degrees.
pub(super) fn pose_words<To, From>(pose: &Transform<To, From>) -> String {
    // Adding 0 turns -0 into 0.
    let three = |v: [f64; 3], unit: f64| v.map(|v| format!("{:.3}", (v * unit * 1e3).round() / 1e3 + 0.0)).join(", ");
    let degrees = 1f64.to_degrees();
    format!(
        "({}) mm, rotation vector ({}) deg",
        three(pose.translation_m(), 1e3),
        three(pose.rotation_vector_rad(), degrees)
    )
}

/// The bits that are on, by the numbers that cell files use.
fn bits_on(bits: u64) -> Vec<u32> {
    (0..64).filter(|n| bits >> n & 1 == 1).collect()
}

fn numbers(list: &[u32]) -> String {
    let all: Vec<_> = list.iter().map(u32::to_string).collect();
    if all.is_empty() { "none".into() } else { all.join(", ") }
}

fn safety_words(bits: u32) -> Vec<&'static str> {
    let words = [
        "normal",
        "reduced",
        "protective stop",
        "recovery",
        "safeguard stop",
        "system emergency stop",
        "robot emergency stop",
        "emergency stopped",
        "violation",
        "fault",
        "stopped due to safety",
        "three-position enabling active",
    ];
    words.into_iter().enumerate().filter(|(n, _)| bits >> n & 1 == 1).map(|(_, word)| word).collect()
}

/// The kinematics of an individual arm.
#[derive(Debug, Args)]
pub(super) struct ShowKinematics {
    /// The cell whose robot it is.
    cell: Option<PathBuf>,
    #[command(flatten)]
    at: Address,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

impl ShowKinematics {
    fn execute(self) -> anyhow::Result<Exit> {
        let cell = self.cell.as_deref().map(load_cell).transpose()?;
        let config = self.at.config(cell.as_ref())?;
        let kinematics = read_kinematics(&config)?;
        let mut monitor = UrMonitor::connect(&config, wall_clock())?;
        let (_, sample) = monitor.next_sample()?;
        let facts = monitor.facts(Some(kinematics.clone()));
        let nominal = nominal_of(&facts).map(|dh| Difference::of(&kinematics.dh, &dh, &sample.joints_rad));
        if nominal.is_none() {
            say("note: no nominal arm to compare with: this version knows that of the UR5e only");
        }
        if !kinematics.calibrated {
            say("warning: the controller says that these parameters are not calibrated");
        }
        if self.json {
            let shown = kinematics_json(&kinematics, &facts, nominal.as_ref());
            print(&format!("{}\n", serde_json::to_string_pretty(&shown)?))?;
        } else {
            print(&kinematics_text(&kinematics, nominal.as_ref()))?;
        }
        Ok(Exit::Ok)
    }
}

/// The nominal parameters of the model that the controller reports; a CB3 arm of the same name has others.
fn nominal_of(facts: &RobotFacts) -> Option<Dh> {
    let ur5 = facts.model.as_deref().is_none_or(|model| model == "UR5" || model == "UR5e");
    (ur5 && facts.controller_version[0] >= 5).then_some(Dh::UR5E)
}

/// An individual arm minus the nominal one.
#[derive(Debug, Clone, PartialEq)]
struct Difference {
    dh: Dh,
    /// Joint positions at which the flanges are compared, rad.
    joints_rad: Joints,
    /// Distance of the flanges there, m.
    flange_m: f64,
    /// Angle between them, rad.
    flange_rad: f64,
}

impl Difference {
    fn of(individual: &Dh, nominal: &Dh, joints_rad: &Joints) -> Self {
        let minus = |a: &Joints, b: &Joints| std::array::from_fn(|i| a[i] - b[i]);
        let [found, ideal]: [Transform<Base, Flange>; 2] = [individual, nominal].map(|dh| dh.forward(joints_rad));
        Self {
            dh: Dh {
                theta_rad: minus(&individual.theta_rad, &nominal.theta_rad),
                a_m: minus(&individual.a_m, &nominal.a_m),
                d_m: minus(&individual.d_m, &nominal.d_m),
                alpha_rad: minus(&individual.alpha_rad, &nominal.alpha_rad),
            },
            joints_rad: *joints_rad,
            flange_m: found.distance_to_m(&ideal),
            flange_rad: found.angle_to_rad(&ideal),
        }
    }
}

fn kinematics_json(kinematics: &Kinematics, facts: &RobotFacts, nominal: Option<&Difference>) -> Value {
    let Kinematics { dh, checksum, calibrated } = kinematics;
    let mut shown = json!({
        "schema_version": SCHEMA_VERSION, "checksum": checksum, "calibrated": calibrated, "dh": dh,
        "controller_version": facts.controller_version.map(|n| n.to_string()).join("."),
    });
    for (key, value) in [("model", &facts.model), ("serial", &facts.serial)] {
        if let Some(value) = value {
            shown[key] = json!(value);
        }
    }
    if let Some(Difference { dh, joints_rad, flange_m, flange_rad }) = nominal {
        shown["minus_nominal"] =
            json!({ "dh": dh, "at_joints_rad": joints_rad, "flange_m": flange_m, "flange_rad": flange_rad });
    }
    shown
}

fn kinematics_text(kinematics: &Kinematics, nominal: Option<&Difference>) -> String {
    let Kinematics { dh, checksum, calibrated } = kinematics;
    let mut text = String::from("joint    theta [deg]         a [mm]         d [mm]    alpha [deg]\n");
    text.push_str(&table(dh, 6));
    text.push_str(if *calibrated { "calibrated\n" } else { "not calibrated\n" });
    if let Some(Difference { dh, flange_m, flange_rad, .. }) = nominal {
        text.push_str("\nminus the nominal UR5e\n");
        text.push_str(&table(dh, 4));
        if dh.d_m[1..4].iter().any(|d| d.abs() > 0.01) {
            text.push_str("d of joints 2 to 4 go far out and back: only their sum means anything\n");
        }
        let (mm, deg) = (flange_m * 1e3, flange_rad.to_degrees());
        text.push_str(&format!("flange at the present joints: {mm:.3} mm and {deg:.4} deg from the nominal one\n"));
    }
    text.push_str(&format!("\nfor the cell, under `robot`:\n  kinematics_checksum: \"{checksum}\"\n"));
    text
}

fn table(dh: &Dh, decimals: usize) -> String {
    let row = |i: usize| {
        let [theta, a] = [dh.theta_rad[i].to_degrees(), dh.a_m[i] * 1e3];
        let [d, alpha] = [dh.d_m[i] * 1e3, dh.alpha_rad[i].to_degrees()];
        format!("{:>5} {theta:>14.decimals$} {a:>14.decimals$} {d:>14.decimals$} {alpha:>14.decimals$}\n", i + 1)
    };
    (0..6).map(row).collect()
}

/// The calibrated arm as URDF.
#[derive(Debug, Args)]
pub(super) struct Urdf {
    /// The cell whose robot it is.
    cell: Option<PathBuf>,
    #[command(flatten)]
    at: Address,
    /// The file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Replaces the file.
    #[arg(long)]
    force: bool,
}

impl Urdf {
    fn execute(self) -> anyhow::Result<Exit> {
        if self.output.exists() && !self.force {
            let path = self.output.display();
            return Err(UsageError(format!("{path} exists already; --force replaces it")).into());
        }
        let cell = self.cell.as_deref().map(load_cell).transpose()?;
        let config = self.at.config(cell.as_ref())?;
        let kinematics = read_kinematics(&config)?;
        if !kinematics.calibrated {
            say("warning: the controller says that its kinematics are not calibrated");
        }
        // Only a beginning: it also tells two files of one arm apart.
        let name = format!("arm_{}", kinematics.checksum.get(..12).unwrap_or_default());
        put(&self.output, &kinematics.dh.to_urdf(&name))?;
        print(&format!("{}\n", self.output.display()))?;
        Ok(Exit::Ok)
    }
}

#[cfg(test)]
mod tests;
