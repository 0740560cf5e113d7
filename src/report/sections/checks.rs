//! The consistency checks, each with what it can and cannot see.

use super::super::document::{Block, Plot, Section, Table};
use super::super::numbers::{count, mm, or_dash, signed_mm};
use super::gates::{self, Gated};
use super::{fact, why};
use crate::calibration::checks::{BaseDistance, DistanceScore, PairDistance, PlaceScore, TargetInBase, TargetToTcp};
use crate::calibration::result::CalibrationResult;

/// How many of the worst poses are named.
const WORST: usize = 3;

/// All checks.
pub(super) fn section(result: &CalibrationResult) -> Section {
    let checks = &result.checks;
    let mut blocks = match (&checks.target_to_tcp, &checks.target_in_base) {
        (Some(check), _) => target_to_tcp(result, check),
        (None, Some(check)) => target_in_base(check),
        (None, None) => {
            let otherwise = match result.hand_eye {
                None => "there is no hand-eye result",
                Some(_) => "no pose could be checked: is the checked corner on the board?",
            };
            let why = why(result, "checks.target_to_tcp", otherwise);
            vec![Block::Heading("Target-to-TCP distance".into()), Block::Absent(why)]
        }
    };
    blocks.extend(match &checks.base_distance {
        Some(check) => base_distance(result, check),
        None => {
            let why = why(result, "checks.base_distance", "no pair of poses with a known distance was seen");
            vec![Block::Heading("Base distance and displacement vector".into()), Block::Absent(why)]
        }
    });
    Section::new("Checks", blocks)
}

fn target_to_tcp(result: &CalibrationResult, check: &TargetToTcp) -> Vec<Block> {
    let heading = format!("Target-to-TCP distance of corner {}, mm", check.corner_id);
    let facts = vec![fact("largest errors", worst_distances(check))];
    let note = "Sees the whole chain of robot, camera, board and hand-eye, through sigma and the errors of single poses. \
                Cannot see much in its mean: an error of 5 mm and 0.5 deg of the camera moved the mean by 0.03 mm, so sigma and \
                max |error| count. Leave-one-out: each pose of the fit, measured with the answer of all others. Held out: poses \
                that were never in the fit.";
    vec![
        Block::Heading(heading),
        Block::Table(target_table(result, check)),
        Block::Facts(facts),
        Block::Note(note.into()),
        Block::Plot(Plot::TargetCheck),
    ]
}

fn target_table(result: &CalibrationResult, check: &TargetToTcp) -> Table {
    let all = DistanceScore {
        count: check.count,
        mean_m: check.mean_m,
        sigma_m: check.sigma_m,
        bias_m: check.bias_m,
        mae_m: check.mae_m,
        max_m: check.max_m,
        max_from_mean_m: check.max_from_mean_m,
    };
    let scores = [Some(&all), check.leave_one_out.as_ref(), check.held_out.as_ref()];
    let mut table = Table::new(&["<quantity", "all poses", "leave-one-out", "held out", "<gate on all poses"]);
    let mut row = |title: &str, gate: String, value: &dyn Fn(&DistanceScore) -> Option<String>| {
        let values = scores.map(|s| s.and_then(value).unwrap_or_else(|| "-".into()));
        table.row(std::iter::once(title.to_owned()).chain(values).chain([gate]));
    };
    let gate = |gated| gates::text(result, gated);
    row("poses", String::new(), &|s| Some(s.count.to_string()));
    row("mean", String::new(), &|s| Some(mm(s.mean_m)));
    row("truth (mechanical)", String::new(), &|_| Some(check.truth_m.map_or_else(|| "unknown".into(), mm)));
    row("bias of the mean", gate(Gated::TargetBias), &|s| s.bias_m.map(signed_mm));
    row("sigma (n - 1)", gate(Gated::TargetSigma), &|s| s.sigma_m.map(mm));
    row("MAE per pose", String::new(), &|s| s.mae_m.map(mm));
    row("max |error|", gate(Gated::TargetMax), &|s| s.max_m.map(mm));
    row("max from the mean", String::new(), &|s| Some(mm(s.max_from_mean_m)));
    table
}

fn worst_distances(check: &TargetToTcp) -> String {
    let error_m = |distance_m: f64, error_m: Option<f64>| error_m.unwrap_or(distance_m - check.mean_m);
    let errors = check.per_pose.iter().map(|p| (p.pose_id.as_str(), error_m(p.distance_m, p.error_m), p.held_out));
    worst(errors.collect(), signed_mm)
}

/// The largest of pose id, error and whether it was held out.
fn worst(mut errors: Vec<(&str, f64, bool)>, shown: fn(f64) -> String) -> String {
    errors.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let text = |(id, error_m, held_out): &(&str, f64, bool)| {
        format!("{id} {} mm{}", shown(*error_m), if *held_out { " (held out)" } else { "" })
    };
    errors.iter().take(WORST).map(text).collect::<Vec<_>>().join(", ")
}

fn target_in_base(check: &TargetInBase) -> Vec<Block> {
    let all = PlaceScore { count: check.count, mean_m: check.mean_m, sigma_m: check.sigma_m, max_m: check.max_m };
    let scores = [Some(&all), check.leave_one_out.as_ref(), check.held_out.as_ref()];
    let mut table = Table::new(&["<quantity", "all poses", "leave-one-out", "held out"]);
    let mut row = |title: &str, value: &dyn Fn(&PlaceScore) -> Option<String>| {
        let values = scores.map(|s| s.and_then(value).unwrap_or_else(|| "-".into()));
        table.row(std::iter::once(title.to_owned()).chain(values));
    };
    row("poses", &|s| Some(s.count.to_string()));
    for (axis, name) in ["mean x in base", "mean y in base", "mean z in base"].into_iter().enumerate() {
        row(name, &|s| s.mean_m.get(axis).copied().map(mm));
    }
    row("sigma (n - 1)", &|s| s.sigma_m.map(mm));
    row("max from the mean", &|s| Some(mm(s.max_m)));
    let errors = check.per_pose.iter().map(|p| (p.pose_id.as_str(), p.error_m, p.held_out)).collect();
    let note = "Sees the whole chain of robot, camera, board and hand-eye, as scatter of a corner that stands still. Cannot \
                see an error that moves the corner by the same at every pose, and has no mechanical truth to compare with. \
                Leave-one-out: each pose of the fit, measured with the answer of all others. Held out: poses that were never in \
                the fit.";
    vec![
        Block::Heading(format!("Place of corner {} in base, mm", check.corner_id)),
        Block::Table(table),
        Block::Facts(vec![fact("farthest", worst(errors, mm))]),
        Block::Note(note.into()),
        Block::Plot(Plot::TargetCheck),
    ]
}

fn base_distance(result: &CalibrationResult, check: &BaseDistance) -> Vec<Block> {
    let mut table = Table::new(&["<pair", "<poses", "measured mm", "truth mm", "error mm", "vector mm", "<move"]);
    for pair in &check.per_pair {
        table.row(pair_cells(pair));
    }
    let pairs = count(check.count, "pair");
    let distance = format!(
        "MAE {} mm, bias {} mm, sigma {} mm, max {} mm over {pairs}",
        mm(check.mae_m),
        signed_mm(check.bias_m),
        or_dash(check.sigma_m, mm),
        mm(check.max_m)
    );
    let seen = check.per_pair.iter().filter(|p| p.vector_error_m.is_some()).count();
    let vector = match check.vector_mae_m {
        Some(mae_m) => {
            format!("MAE {} mm, max {} mm over {}", mm(mae_m), or_dash(check.vector_max_m, mm), count(seen, "pair"))
        }
        None => "absent: it needs a hand-eye result and robot poses".into(),
    };
    let mut facts = vec![fact("distance", distance)];
    facts.extend(gate_fact(result, "distance gate", Gated::DistanceMae));
    facts.push(fact("vector", vector));
    facts.extend(gate_fact(result, "vector gate", Gated::VectorMae));
    let distance_note = "Distance: sees the cameras and the board poses. Cannot see anything of the hand-eye result, because \
                         |X p1 - X p2| = |p1 - p2| for every rigid X.";
    let vector_note = "Vector, against the robot's own displacement: sees the rotation of the hand-eye result too. Cannot see \
                       its translation; only target-to-TCP or a touched point can.";
    vec![
        Block::Heading("Base distance and displacement vector".into()),
        Block::Table(table),
        Block::Facts(facts),
        Block::Note(distance_note.into()),
        Block::Note(vector_note.into()),
    ]
}

fn gate_fact(result: &CalibrationResult, name: &str, gated: Gated) -> Option<(String, String)> {
    let text = gates::text(result, gated);
    (!text.is_empty()).then(|| fact(name, text))
}

fn pair_cells(pair: &PairDistance) -> [String; 7] {
    let moved = match pair.pure_translation {
        Some(true) => "pure translation",
        Some(false) => "also turned",
        None => "",
    };
    [
        pair.pair.clone(),
        format!("{}, {}", pair.pose_a, pair.pose_b),
        mm(pair.distance_m),
        mm(pair.truth_m),
        signed_mm(pair.error_m),
        or_dash(pair.vector_error_m, mm),
        moved.into(),
    ]
}
