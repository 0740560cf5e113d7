//! Gates: the limits of the cell against what was measured, and the verdict.
//!
//! Uses `settings`. Start at [`judge`].

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::settings::Gates;
use crate::geometry::Camera;

/// Whether a calibration may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Every gate was judged and kept.
    Pass,
    /// At least one gate was missed.
    Fail,
    /// No gate was missed, but one could not be judged, or there were none.
    Inconclusive,
}

/// The answer to "is it good?".
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// The answer.
    pub status: Status,
    /// Why it is not `pass`, one sentence each: missed gates first, then those that could not be judged.
    pub reasons: Vec<String>,
}

/// What was measured of each gated quantity; `None` where it could not be computed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measured {
    /// RMS reprojection error of the frame camera, px.
    pub rgb_rms_px: Option<f64>,
    /// RMS reprojection error of the event camera, px.
    pub event_rms_px: Option<f64>,
    /// RMS reprojection error of the stereo pair, px.
    pub stereo_rms_px: Option<f64>,
    /// Share of corners found by each camera of the cell, 0 to 1; a camera without a number is `None`.
    pub corner_rate: BTreeMap<Camera, Option<f64>>,
    /// Standard deviation of the target-to-TCP distance, m.
    pub target_to_tcp_sigma_m: Option<f64>,
    /// Largest |error| of the target-to-TCP distance at one pose, m.
    pub target_to_tcp_max_m: Option<f64>,
    /// Mean error of the target-to-TCP distance, m, with its sign.
    pub target_to_tcp_bias_m: Option<f64>,
    /// Mean absolute error of the base-frame distances, m.
    pub base_distance_mae_m: Option<f64>,
    /// Mean error of the displacement vectors, m.
    pub base_vector_mae_m: Option<f64>,
    /// Largest distance between the translations of two hand-eye solvers, m.
    pub panel_spread_m: Option<f64>,
    /// Largest distance of a model of the arm from the controller's poses, m.
    pub kinematics_m: Option<f64>,
    /// Largest angle between them, rad.
    pub kinematics_rad: Option<f64>,
}

/// How a number is written: factor from the inner unit, unit, decimals.
#[derive(Clone, Copy)]
struct Shown {
    factor: f64,
    unit: &'static str,
    decimals: usize,
}

const PX: Shown = Shown { factor: 1.0, unit: "px", decimals: 3 };
const MM: Shown = Shown { factor: 1e3, unit: "mm", decimals: 2 };
const DEG: Shown = Shown { factor: 180.0 / std::f64::consts::PI, unit: "deg", decimals: 3 };
const PERCENT: Shown = Shown { factor: 100.0, unit: "%", decimals: 1 };

/// One gate with its measurement.
struct Gate {
    name: String,
    shown: Shown,
    limit: f64,
    measured: Option<f64>,
    /// The measurement must not be below the limit; otherwise not above.
    at_least: bool,
}

/// Judges what was measured by the gates of the cell.
///
/// Any gate missed: `fail`; otherwise any gate that could not be judged, or no gates: `inconclusive`.
/// A measurement or a gate that is NaN is missed.
pub fn judge(gates: &Gates, measured: &Measured) -> Verdict {
    let gates = list(gates, measured);
    if gates.is_empty() {
        return Verdict { status: Status::Inconclusive, reasons: vec!["no gates".into()] };
    }
    let missed: Vec<String> = gates.iter().filter_map(Gate::missed).collect();
    let unjudged = gates.iter().filter_map(Gate::unjudged);
    let failed = !missed.is_empty();
    let reasons: Vec<String> = missed.into_iter().chain(unjudged).collect();
    let status = match (failed, reasons.is_empty()) {
        (true, _) => Status::Fail,
        (false, false) => Status::Inconclusive,
        (false, true) => Status::Pass,
    };
    Verdict { status, reasons }
}

/// The gates that are set, in the order of the settings.
fn list(gates: &Gates, measured: &Measured) -> Vec<Gate> {
    // Named field by field, so that a new gate does not compile until it is judged.
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
    let m = measured;
    let bias_m = m.target_to_tcp_bias_m.map(f64::abs);
    let mut all = vec![
        at_most("rgb rms", PX, rgb_rms_px, m.rgb_rms_px),
        at_most("event rms", PX, event_rms_px, m.event_rms_px),
        at_most("stereo rms", PX, stereo_rms_px, m.stereo_rms_px),
    ];
    all.extend(corner_rates(corner_rate, &m.corner_rate).into_iter().map(Some));
    all.extend([
        at_most("target_to_tcp sigma", MM, target_to_tcp_sigma_m, m.target_to_tcp_sigma_m),
        at_most("target_to_tcp max", MM, target_to_tcp_max_m, m.target_to_tcp_max_m),
        at_most("target_to_tcp |bias|", MM, target_to_tcp_bias_m, bias_m),
        at_most("base_distance mae", MM, base_distance_mae_m, m.base_distance_mae_m),
        at_most("base_distance vector mae", MM, base_vector_mae_m, m.base_vector_mae_m),
        at_most("hand-eye panel spread", MM, panel_spread_m, m.panel_spread_m),
        at_most("kinematics distance", MM, kinematics_m, m.kinematics_m),
        at_most("kinematics angle", DEG, kinematics_rad, m.kinematics_rad),
    ]);
    all.into_iter().flatten().collect()
}

fn at_most(name: &str, shown: Shown, limit: Option<f64>, measured: Option<f64>) -> Option<Gate> {
    Some(Gate { name: name.into(), shown, limit: limit?, measured, at_least: false })
}

/// One gate for each camera of the cell; without any camera the gate cannot be judged.
fn corner_rates(limit: Option<f64>, rates: &BTreeMap<Camera, Option<f64>>) -> Vec<Gate> {
    let Some(limit) = limit else { return Vec::new() };
    let gate = |name, measured| Gate { name, shown: PERCENT, limit, measured, at_least: true };
    if rates.is_empty() {
        return vec![gate("corner rate".into(), None)];
    }
    rates.iter().map(|(camera, rate)| gate(format!("{camera} corner rate"), *rate)).collect()
}

impl Gate {
    fn missed(&self) -> Option<String> {
        let Self { name, shown, limit, measured, at_least } = self;
        let value = (*measured)?;
        let kept = value.is_finite() && if *at_least { value >= *limit } else { value <= *limit };
        if kept {
            return None;
        }
        let (value_text, limit_text) = shown.apart(value, *limit);
        if !value.is_finite() || limit.is_nan() {
            return Some(format!("{name} {value_text} cannot be compared with the gate {limit_text}"));
        }
        let side = if *at_least { "below" } else { "above" };
        Some(format!("{name} {value_text} is {side} the gate {limit_text}"))
    }

    fn unjudged(&self) -> Option<String> {
        let Self { name, shown, limit, measured, .. } = self;
        let limit_text = shown.text(*limit, shown.decimals);
        measured.is_none().then(|| format!("{name} could not be computed; its gate is {limit_text}"))
    }
}

impl Shown {
    fn text(&self, value: f64, decimals: usize) -> String {
        format!("{:.decimals$} {}", value * self.factor, self.unit)
    }

    /// Two numbers with the usual decimals, or as many more as show that they differ.
    fn apart(&self, a: f64, b: f64) -> (String, String) {
        let texts = |decimals| (self.text(a, decimals), self.text(b, decimals));
        let apart = (self.decimals..=12).map(texts).find(|(a, b)| a != b);
        apart.unwrap_or_else(|| texts(self.decimals))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_gate() -> Gates {
        Gates {
            rgb_rms_px: Some(0.3),
            event_rms_px: Some(0.6),
            stereo_rms_px: Some(0.5),
            corner_rate: Some(0.95),
            target_to_tcp_sigma_m: Some(0.0015),
            target_to_tcp_max_m: Some(0.004),
            target_to_tcp_bias_m: Some(0.001),
            base_distance_mae_m: Some(0.002),
            base_vector_mae_m: Some(0.002),
            panel_spread_m: Some(0.003),
            kinematics_m: Some(0.005),
            kinematics_rad: Some(0.01),
        }
    }

    fn good() -> Measured {
        Measured {
            rgb_rms_px: Some(0.14),
            event_rms_px: Some(0.45),
            stereo_rms_px: Some(0.38),
            corner_rate: [(Camera::Rgb, Some(1.0)), (Camera::Event, Some(0.998))].into(),
            target_to_tcp_sigma_m: Some(0.0009),
            target_to_tcp_max_m: Some(0.002),
            target_to_tcp_bias_m: Some(-0.0007),
            base_distance_mae_m: Some(0.001),
            base_vector_mae_m: Some(0.001),
            panel_spread_m: Some(0.001),
            kinematics_m: Some(0.004),
            kinematics_rad: Some(0.009),
        }
    }

    #[test]
    fn what_keeps_every_gate_passes() {
        assert_eq!(judge(&every_gate(), &good()), Verdict { status: Status::Pass, reasons: vec![] });
    }

    #[test]
    fn a_missed_gate_fails_and_says_by_how_much() {
        let measured = Measured { target_to_tcp_sigma_m: Some(0.00183), ..good() };
        let verdict = judge(&every_gate(), &measured);
        assert_eq!(verdict.status, Status::Fail);
        assert_eq!(verdict.reasons, ["target_to_tcp sigma 1.83 mm is above the gate 1.50 mm"]);
        let close = Measured { target_to_tcp_sigma_m: Some(0.0015004), ..good() };
        let reasons = judge(&every_gate(), &close).reasons;
        assert_eq!(reasons, ["target_to_tcp sigma 1.5004 mm is above the gate 1.5000 mm"]);
    }

    #[test]
    fn a_bias_counts_on_both_sides_and_a_corner_rate_from_below() {
        let rates = [(Camera::Rgb, Some(1.0)), (Camera::Event, Some(0.5))];
        let measured = Measured { target_to_tcp_bias_m: Some(-0.0012), corner_rate: rates.into(), ..good() };
        let reasons = judge(&every_gate(), &measured).reasons;
        let expected = [
            "event corner rate 50.0 % is below the gate 95.0 %",
            "target_to_tcp |bias| 1.20 mm is above the gate 1.00 mm",
        ];
        assert_eq!(reasons, expected);
    }

    #[test]
    fn each_gate_can_fail_and_each_can_be_unjudged() {
        let bad = Measured {
            rgb_rms_px: Some(9.0),
            event_rms_px: Some(9.0),
            stereo_rms_px: Some(9.0),
            corner_rate: [(Camera::Event, Some(0.0))].into(),
            target_to_tcp_sigma_m: Some(9.0),
            target_to_tcp_max_m: Some(9.0),
            target_to_tcp_bias_m: Some(9.0),
            base_distance_mae_m: Some(9.0),
            base_vector_mae_m: Some(9.0),
            panel_spread_m: Some(9.0),
            kinematics_m: Some(9.0),
            kinematics_rad: Some(9.0),
        };
        assert_eq!(judge(&every_gate(), &bad).reasons.len(), 12);
        let nothing = judge(&every_gate(), &Measured::default());
        assert_eq!((nothing.status, nothing.reasons.len()), (Status::Inconclusive, 12));
        assert_eq!(nothing.reasons[4], "target_to_tcp sigma could not be computed; its gate is 1.50 mm");
    }

    #[test]
    fn nan_fails_on_either_side() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let measured = Measured { event_rms_px: Some(bad), ..good() };
            assert_eq!(judge(&every_gate(), &measured).status, Status::Fail, "{bad}");
            let measured = Measured { corner_rate: [(Camera::Rgb, Some(bad))].into(), ..good() };
            assert_eq!(judge(&every_gate(), &measured).status, Status::Fail, "{bad}");
        }
        let gates = Gates { event_rms_px: Some(f64::NAN), ..every_gate() };
        assert_eq!(judge(&gates, &good()).status, Status::Fail);
    }

    #[test]
    fn a_failure_outweighs_what_is_missing_and_missing_outweighs_passing() {
        let partly = Measured { panel_spread_m: None, ..good() };
        assert_eq!(judge(&every_gate(), &partly).status, Status::Inconclusive);
        let both = Measured { panel_spread_m: None, event_rms_px: Some(2.0), ..good() };
        let verdict = judge(&every_gate(), &both);
        assert_eq!((verdict.status, verdict.reasons.len()), (Status::Fail, 2));
        let lost = Measured { corner_rate: [(Camera::Rgb, Some(1.0)), (Camera::Event, None)].into(), ..good() };
        let verdict = judge(&every_gate(), &lost);
        assert_eq!(verdict.reasons, ["event corner rate could not be computed; its gate is 95.0 %"]);
    }

    #[test]
    fn without_gates_nothing_is_decided() {
        let verdict = judge(&Gates::default(), &good());
        let json = serde_json::to_string(&verdict).unwrap();
        assert_eq!(json, r#"{"status":"inconclusive","reasons":["no gates"]}"#);
        // An unset gate is not judged, even where the quantity is bad.
        let gates = Gates { rgb_rms_px: Some(0.3), ..Gates::default() };
        let measured = Measured { event_rms_px: Some(f64::NAN), ..good() };
        assert_eq!(judge(&gates, &measured).status, Status::Pass);
    }
}
