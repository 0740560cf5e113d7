//! `cellcal study`: experiments on the simulator, against its truth.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::json;

use super::exit::UsageError;
use super::progress::{Bar, say};
use super::{Exit, cell, print};
use crate::study::accuracy::{self, Row, SessionErrors};

/// Experiments on the simulator, against its truth.
#[derive(Debug, Subcommand)]
pub(super) enum Study {
    /// Both methods on the same simulated sessions: medians of the errors, and what is asked of them.
    Accuracy(Accuracy),
}

/// Both methods on the same simulated sessions.
#[derive(Debug, Args)]
pub(super) struct Accuracy {
    /// Sessions of each cell.
    #[arg(long, default_value = "10", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    seeds: u32,
    /// The first seed; the others follow.
    #[arg(long, default_value = "501")]
    first_seed: u64,
    /// Cells; may be repeated.
    #[arg(long = "cell", default_values = ["cells/sim.yaml", "cells/sim-rig.yaml"])]
    cells: Vec<PathBuf>,
    /// Folder of the results; sessions that are there are not run again.
    #[arg(short, long, default_value = "studies/accuracy")]
    output: PathBuf,
    /// As JSON, with every session.
    #[arg(long)]
    json: bool,
}

impl Study {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        match self {
            Self::Accuracy(command) => command.execute(),
        }
    }
}

impl Accuracy {
    fn execute(self) -> anyhow::Result<Exit> {
        let wrong = |why: std::io::Error| UsageError(format!("{}: {why}", self.output.display()));
        std::fs::create_dir_all(&self.output).map_err(wrong)?;
        let bar = Bar::new("sessions");
        let total = self.cells.len() * self.seeds as usize;
        let mut sessions = Vec::new();
        for path in &self.cells {
            let texts = cell::load(path)?;
            let name = path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            for seed in (0..u64::from(self.seeds)).map(|i| self.first_seed + i) {
                bar.show(sessions.len(), total);
                let one = accuracy::one(&texts, &name, seed, &self.output)?;
                say(&told(&one));
                sessions.push(one);
            }
        }
        bar.show(total, total);
        let rows = accuracy::rows(&sessions);
        let csv = self.output.join("accuracy.csv");
        std::fs::write(&csv, csv_of(&sessions))?;
        say(&format!("every session: {}", csv.display()));
        let covered = sessions.iter().fold([0; 2], |c, s| [0, 1].map(|i| c[i] + s.precise.covered[i]));
        if self.json {
            let all = json!({ "rows": rows, "covered_95": covered, "sessions": sessions });
            print(&format!("{}\n", serde_json::to_string_pretty(&all)?))?;
        } else {
            print(&table(&rows, covered, sessions.len()))?;
        }
        Ok(if rows.iter().all(|r| r.kept != Some(false)) { Exit::Ok } else { Exit::GateFailed })
    }
}

fn told(one: &SessionErrors) -> String {
    let of = |name: &str| one.paper.values.get(name).zip(one.precise.values.get(name));
    let pair = |name: &str| of(name).map_or_else(|| "-".to_owned(), |(a, b)| format!("{a:.3} -> {b:.3}"));
    format!(
        "{} seed {}: stereo {} mm, hand-eye {} mm, event model {} px",
        one.cell,
        one.seed,
        pair("stereo_translation_mm"),
        pair("hand_eye_translation_mm"),
        pair("event_model_px")
    )
}

fn table(rows: &[Row], [covered, judged]: [u32; 2], sessions: usize) -> String {
    let mut text = format!("medians of {sessions} simulated sessions\n");
    let _ = writeln!(text, "{:<28}{:>10}{:>10}{:>8}  asked", "", "paper", "precise", "ratio");
    for Row { name, paper, precise, ratio, goal, kept, .. } in rows {
        let kept = kept.map_or("", |kept| if kept { "  kept" } else { "  MISSED" });
        let _ = writeln!(text, "{name:<28}{paper:>10.4}{precise:>10.4}{ratio:>8.3}  {goal}{kept}");
    }
    if judged > 0 {
        let share = 100.0 * f64::from(covered) / f64::from(judged);
        let _ = writeln!(text, "95 % intervals that hold the truth: {covered} of {judged} ({share:.1} %)");
    }
    text
}

fn csv_of(sessions: &[SessionErrors]) -> String {
    let mut text = String::from("cell,seed,method,poses");
    for (name, _) in accuracy::ROWS {
        let _ = write!(text, ",{name}");
    }
    text.push('\n');
    for session in sessions {
        for (method, errors) in [("paper", &session.paper), ("precise", &session.precise)] {
            let _ = write!(text, "{},{},{method},{}", session.cell, session.seed, session.poses);
            for (name, _) in accuracy::ROWS {
                let value = errors.values.get(name).map(ToString::to_string).unwrap_or_default();
                let _ = write!(text, ",{value}");
            }
            text.push('\n');
        }
    }
    text
}
