//! `cellcal plan`: one set of poses for cameras, stereo, hand-eye and checks, in one short tour.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::cell::load;
use super::exit::UsageError;
use super::progress::{Bar, say};
use super::teach::put;
use super::{Exit, print, read_text};
use crate::config::{self, Cell, PoseKind};
use crate::geometry::kinematics::Arm;
use crate::plan::propose::{Accuracy, Wish, accuracy, propose};
use crate::plan::{Plan, expand_with};

/// Proposes a trajectory that serves cameras, stereo, hand-eye and checks in one tour; needs no hardware.
#[derive(Debug, Args)]
pub(super) struct PlanPoses {
    /// The cell file; its `nominal` places, focal lengths, limits and keep-out boxes are what poses are chosen by.
    cell: PathBuf,
    /// The trajectory file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Name of the trajectory. Default: that of the file.
    #[arg(long)]
    name: Option<String>,
    /// Largest number of poses.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=200))]
    poses: u16,
    /// Longest robot time from home and back, with all captures, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Seed of the search: the same cell and seed give the same poses.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Nearest and farthest distance of the board from the camera, mm. Default: about that at home.
    #[arg(long, num_args = 2, value_names = ["NEAR", "FAR"])]
    depth_mm: Option<Vec<f64>>,
    /// Replaces the file.
    #[arg(long)]
    force: bool,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

impl PlanPoses {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let name = self.name()?;
        let text = read_text(&self.cell)?;
        let cell = config::parse_cell(&text, &self.cell.display().to_string())?;
        let arm = arm_of(&self.cell, &cell)?;
        let wish = self.wish()?;
        let bar = Bar::new("choosing poses");
        let found = propose(&cell, &arm, &wish, &|done, all| bar.show(done, all));
        let found = found.map_err(|why| UsageError(format!("{}: {why}", self.cell.display())))?;
        let header = header(&cell, &wish, &found.accuracy);
        let text = config::tour_yaml(&name, cell.reference_camera(), &found.parts, &header);
        // What is written is what is judged: read back and planned as `run` would.
        let shown = self.output.display().to_string();
        let tour = config::parse_trajectory(&text, &shown)?;
        let plan = expand_with(&cell, &arm, &[(PoseKind::HandEye, tour)])?;
        let own = Own::of(&self.cell, found.depths_m);
        put(&self.output, &text)?;
        let this = accuracy(&cell, &plan, found.depths_m).unwrap_or(found.accuracy);
        self.tell(&plan, &this, &own)?;
        Ok(Exit::Ok)
    }

    fn name(&self) -> anyhow::Result<String> {
        let shown = self.output.display();
        if self.output.exists() && !self.force {
            return Err(UsageError(format!("{shown} exists already; --force replaces it")).into());
        }
        let stem = self.output.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        let name = self.name.as_deref().unwrap_or(stem);
        if !config::is_name(name) {
            let why = "cannot be the name of a trajectory: give one with --name, 1 to 64 letters, digits, - and _";
            return Err(UsageError(format!("{name:?} {why}")).into());
        }
        Ok(name.into())
    }

    fn wish(&self) -> anyhow::Result<Wish> {
        let depths_m = self.depth_mm.as_ref().map(|mm| [mm[0] / 1e3, mm[1] / 1e3]);
        let ordered = depths_m.is_none_or(|[near, far]| near >= 0.01 && far <= 10.0 && near <= far);
        if !ordered {
            return Err(UsageError("--depth-mm: give the nearest first, 10 to 10000".into()).into());
        }
        let lasts = (1.0..=36_000.0).contains(&self.seconds);
        if !lasts {
            return Err(UsageError(format!("--seconds is {}, outside 1 to 36000", self.seconds)).into());
        }
        Ok(Wish { poses: self.poses.into(), seconds: self.seconds, seed: self.seed, depths_m })
    }

    fn tell(&self, plan: &Plan, accuracy: &Accuracy, own: &Result<Own, String>) -> anyhow::Result<()> {
        let this = Column { title: "this tour".into(), duration_s: plan.duration_s, accuracy: *accuracy };
        let poses = plan.poses.len();
        if self.json {
            let own = own.as_ref().ok().map(|own| own.0.json());
            let report = json!({ "trajectory": self.output.display().to_string(), "poses": poses, "this": this.json(), "own": own });
            return print(&format!("{}\n", serde_json::to_string_pretty(&report)?));
        }
        for warning in &plan.warnings {
            say(&format!("note: {warning}"));
        }
        let kinds = [PoseKind::Intrinsics, PoseKind::HandEye, PoseKind::Distance];
        let [intrinsics, for_arm, distance] = kinds.map(|kind| plan.poses.iter().filter(|p| p.kind == kind).count());
        let shown = self.output.display();
        let mut text =
            format!("{shown}: {poses} poses ({for_arm} hand-eye, {distance} distance, {intrinsics} cameras only)\n");
        let mut columns = vec![this];
        match own {
            Ok(Own(column)) => columns.push(column.clone()),
            Err(why) => text.push_str(&format!("nothing to compare with: {why}\n")),
        }
        text.push_str(&table(&columns));
        print(&text)
    }
}

/// The model of the arm: the cell's URDF, or the nominal UR5e.
fn arm_of(file: &Path, cell: &Cell) -> anyhow::Result<Arm> {
    let Some(urdf) = &cell.robot.urdf else { return Ok(Arm::ur5e()) };
    let path = file.parent().unwrap_or(Path::new(".")).join(urdf);
    let arm = Arm::from_urdf(&read_text(&path)?);
    Ok(arm.map_err(|why| UsageError(format!("{}: {why}", path.display())))?)
}

/// What the cell's own trajectories are worth.
struct Own(Column);

impl Own {
    /// The error says why there is nothing to compare with.
    fn of(file: &Path, depths_m: [f64; 2]) -> Result<Self, String> {
        let planned = load(file).and_then(|texts| Ok(texts.plan()?)).map_err(|why| why.to_string())?;
        let counts = [PoseKind::Intrinsics, PoseKind::HandEye, PoseKind::Distance];
        let counts = counts.map(|kind| planned.plan.poses.iter().filter(|p| p.kind == kind).count());
        let title = format!("cell's own {}", counts.map(|n| n.to_string()).join(" + "));
        let accuracy = accuracy(&planned.cell, &planned.plan, depths_m).ok_or("its poses tell nothing")?;
        Ok(Self(Column { title, duration_s: planned.plan.duration_s, accuracy }))
    }
}

/// One set of poses in the table.
#[derive(Clone)]
struct Column {
    title: String,
    duration_s: f64,
    accuracy: Accuracy,
}

impl Column {
    fn json(&self) -> serde_json::Value {
        let Accuracy { stereo_m, stereo_rad, camera_m, camera_rad, workspace_95_m } = self.accuracy;
        json!({
            "duration_s": self.duration_s, "stereo_sigma_m": stereo_m, "stereo_sigma_rad": stereo_rad,
            "camera_sigma_m": camera_m, "camera_sigma_rad": camera_rad, "workspace_95_m": workspace_95_m,
        })
    }
}

/// One line for each quantity, one column for each set of poses.
fn table(columns: &[Column]) -> String {
    let mm = |v: f64| format!("{:.3}", v * 1e3);
    let mrad = |v: f64| format!("{:.3}", v * 1e3);
    type Cell<'a> = &'a dyn Fn(&Column) -> Option<String>;
    let rows: [(&str, Cell<'_>); 6] = [
        ("robot time, s", &|c| Some(format!("{:.0}", c.duration_s))),
        ("stereo translation, sigma, mm", &|c| c.accuracy.stereo_m.map(mm)),
        ("stereo rotation, sigma, mrad", &|c| c.accuracy.stereo_rad.map(mrad)),
        ("camera translation, sigma, mm", &|c| Some(mm(c.accuracy.camera_m))),
        ("camera rotation, sigma, mrad", &|c| Some(mrad(c.accuracy.camera_rad))),
        ("worst workspace corner, 95 %, mm", &|c| Some(mm(c.accuracy.workspace_95_m))),
    ];
    let mut text = format!("{:<34}", "predicted");
    text.extend(columns.iter().map(|c| format!("{:>24}", c.title)));
    for (title, cell) in rows {
        let cells: Option<Vec<String>> = columns.iter().map(|c| cell(c).map(|v| format!("{v:>24}"))).collect();
        text.extend(cells.map(|cells| format!("\n{title:<34}{}", cells.concat())));
    }
    text.push_str("\nsystematic errors (square size, bent display, kinematics of the arm) come on top\n");
    text
}

/// What stands above the poses.
fn header(cell: &Cell, wish: &Wish, accuracy: &Accuracy) -> Vec<String> {
    let Wish { poses, seconds, seed, .. } = wish;
    vec![
        format!(
            "One tour for cameras, stereo, hand-eye and checks, proposed by `cellcal plan` for the cell {}:",
            cell.name
        ),
        format!(
            "at most {poses} poses and {seconds} s, seed {seed}; predicted 95 % error at the workspace corners {:.2} mm.",
            accuracy.workspace_95_m * 1e3
        ),
    ]
}
