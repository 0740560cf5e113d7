//! The gates of the cell beside what was measured.

use super::super::document::{Block, Section, Table, Tone};
use super::super::numbers::{fixed, mm, percent, px};
use crate::calibration::result::CalibrationResult;
use crate::calibration::settings::Gates;
use crate::geometry::Camera;

/// A gated quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gated {
    CameraRms(Camera),
    StereoRms,
    CornerRate(Camera),
    TargetSigma,
    TargetMax,
    TargetBias,
    DistanceMae,
    VectorMae,
    PanelSpread,
    KinematicsDistance,
    KinematicsAngle,
}

/// A gate with its measurement.
struct Gate {
    gated: Gated,
    limit: f64,
    measured: Option<f64>,
}

impl Gated {
    fn name(self) -> String {
        match self {
            Self::CameraRms(camera) => format!("{camera} rms"),
            Self::StereoRms => "stereo rms".into(),
            Self::CornerRate(camera) => format!("{camera} corner rate"),
            Self::TargetSigma => "target-to-TCP sigma".into(),
            Self::TargetMax => "target-to-TCP max |error|".into(),
            Self::TargetBias => "target-to-TCP |bias|".into(),
            Self::DistanceMae => "base distance MAE".into(),
            Self::VectorMae => "displacement vector MAE".into(),
            Self::PanelSpread => "panel spread".into(),
            Self::KinematicsDistance => "kinematics distance".into(),
            Self::KinematicsAngle => "kinematics angle".into(),
        }
    }

    fn shown(self, value: f64) -> String {
        match self {
            Self::CameraRms(_) | Self::StereoRms => format!("{} px", px(value)),
            Self::CornerRate(_) => format!("{} %", percent(value)),
            Self::TargetSigma | Self::TargetMax | Self::TargetBias => format!("{} mm", mm(value)),
            Self::DistanceMae | Self::VectorMae | Self::PanelSpread | Self::KinematicsDistance => {
                format!("{} mm", mm(value))
            }
            Self::KinematicsAngle => format!("{} deg", fixed(value.to_degrees(), 3)),
        }
    }

    fn at_least(self) -> bool {
        matches!(self, Self::CornerRate(_))
    }
}

impl Gate {
    /// Written so that NaN is missed, as the verdict has it.
    fn kept(&self) -> Option<bool> {
        let value = self.measured?;
        Some(value.is_finite() && if self.gated.at_least() { value >= self.limit } else { value <= self.limit })
    }

    fn state(&self) -> (&'static str, Tone) {
        match self.kept() {
            Some(true) => ("kept", Tone::Plain),
            Some(false) => ("MISSED", Tone::Bad),
            None => ("not judged", Tone::Alert),
        }
    }

    fn limit_text(&self) -> String {
        let side = if self.gated.at_least() { "at least" } else { "at most" };
        format!("{side} {}", self.gated.shown(self.limit))
    }

    /// How much of the allowance is used up, in percent.
    fn used(&self) -> String {
        let share =
            self.measured.map(|v| if self.gated.at_least() { (1.0 - v) / (1.0 - self.limit) } else { v / self.limit });
        share.filter(|s| s.is_finite()).map_or_else(|| "-".into(), |s| fixed(s * 100.0, 0))
    }
}

/// Every gate that is set.
pub(super) fn section(result: &CalibrationResult) -> Section {
    let gates = list(result);
    if gates.is_empty() {
        return Section::absent("Gates", "the session has no gates, so nothing could be judged");
    }
    let mut table = Table::new(&["<state", "<quantity", "measured", "gate", "% used"]);
    for gate in &gates {
        let measured = gate.measured.map_or_else(|| "-".into(), |v| gate.gated.shown(v));
        let (state, tone) = gate.state();
        table.toned(tone, [state.into(), gate.gated.name(), measured, gate.limit_text(), gate.used()]);
    }
    Section::new("Gates", vec![Block::Table(table)])
}

/// The gate on a quantity and whether it was kept, in words; empty where there is none.
pub(super) fn text(result: &CalibrationResult, gated: Gated) -> String {
    let gate = list(result).into_iter().find(|g| g.gated == gated);
    gate.map_or_else(String::new, |g| format!("{}: {}", g.limit_text(), g.state().0))
}

fn list(result: &CalibrationResult) -> Vec<Gate> {
    let Some(gates) = &result.provenance.gates else { return Vec::new() };
    // Named field by field, so that a new gate does not compile until it is shown.
    let &Gates {
        rgb_rms_px,
        event_rms_px,
        stereo_rms_px,
        corner_rate,
        target_to_tcp_sigma_m,
        target_to_tcp_max_m,
        target_to_tcp_bias_m,
        base_distance_mae_m,
        base_vector_mae_m,
        panel_spread_m,
        kinematics_m,
        kinematics_rad,
    } = gates;
    let cameras = [(Camera::Rgb, rgb_rms_px), (Camera::Event, event_rms_px)];
    let rms = cameras.map(|(camera, limit)| (Gated::CameraRms(camera), limit));
    let rates = result.cameras.keys().map(|camera| (Gated::CornerRate(*camera), corner_rate));
    let others = [
        (Gated::TargetSigma, target_to_tcp_sigma_m),
        (Gated::TargetMax, target_to_tcp_max_m),
        (Gated::TargetBias, target_to_tcp_bias_m),
        (Gated::DistanceMae, base_distance_mae_m),
        (Gated::VectorMae, base_vector_mae_m),
        (Gated::PanelSpread, panel_spread_m),
        (Gated::KinematicsDistance, kinematics_m),
        (Gated::KinematicsAngle, kinematics_rad),
    ];
    let all = rms.into_iter().chain([(Gated::StereoRms, stereo_rms_px)]).chain(rates).chain(others);
    let gate =
        |(gated, limit): (Gated, Option<f64>)| Some(Gate { gated, limit: limit?, measured: measured(result, gated) });
    all.filter_map(gate).collect()
}

fn measured(result: &CalibrationResult, gated: Gated) -> Option<f64> {
    let target = result.checks.target_to_tcp.as_ref();
    let distance = result.checks.base_distance.as_ref();
    match gated {
        Gated::CameraRms(camera) => result.cameras.get(&camera).map(|c| c.rms_px),
        Gated::StereoRms => result.stereo.as_ref().map(|s| s.rms_px),
        Gated::CornerRate(camera) => result.cameras.get(&camera).map(|c| c.corner_rate),
        Gated::TargetSigma => target.and_then(|t| t.sigma_m),
        Gated::TargetMax => target.and_then(|t| t.max_m),
        Gated::TargetBias => target.and_then(|t| t.bias_m).map(f64::abs),
        Gated::DistanceMae => distance.map(|d| d.mae_m),
        Gated::VectorMae => distance.and_then(|d| d.vector_mae_m),
        Gated::PanelSpread => result.hand_eye.as_ref().and_then(|h| h.panel_spread_m),
        Gated::KinematicsDistance => result.kinematics.as_ref().and_then(|k| k.max_m()),
        Gated::KinematicsAngle => result.kinematics.as_ref().and_then(|k| k.max_rad()),
    }
}
