//! Corners of both cameras against the simulator's truth: the paper's method beside the precise one.

use std::path::Path;

use cellcal::board::View;
use cellcal::calibration::settings::PoseKind;
use cellcal::config::{parse_cell, parse_trajectory};
use cellcal::devices::sim::cell::SimCell;
use cellcal::events::{Answered, LastPolarity, Sink as _};
use cellcal::geometry::{Base, Flange, Transform};
use cellcal::plan;
use cellcal::vision::{self, precise};
use rayon::prelude::*;

fn read(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

/// Errors of one detector: px from the truth, and the corners that it should have found.
#[derive(Default)]
struct Errors {
    px: Vec<[f64; 2]>,
    /// The same over the stated standard deviations.
    standardised: Vec<f64>,
    possible: usize,
}

impl Errors {
    fn add(&mut self, view: &View, truth: impl Fn(u32) -> Option<[f64; 2]>) {
        for id in 0..24 {
            let Some([u, v]) = truth(id) else { continue };
            self.possible += 1;
            let Some(corner) = view.corners.iter().find(|c| c.id == id) else {
                eprintln!("missing {id} at {u:.0} {v:.0} of {}", view.corners.len());
                continue;
            };
            let error = [corner.px[0] - u, corner.px[1] - v];
            self.px.push(error);
            if let Some([xx, _, yy]) = corner.covariance_px2 {
                self.standardised.extend([error[0] / xx.sqrt(), error[1] / yy.sqrt()]);
            }
        }
    }

    fn rms_px(&self) -> f64 {
        (self.px.iter().map(|e| e[0] * e[0] + e[1] * e[1]).sum::<f64>() / self.px.len() as f64).sqrt()
    }

    fn mean_px(&self) -> [f64; 2] {
        [0, 1].map(|i| self.px.iter().map(|e| e[i]).sum::<f64>() / self.px.len() as f64)
    }

    fn worst_px(&self) -> f64 {
        self.px.iter().map(|e| e[0].hypot(e[1])).fold(0.0, f64::max)
    }

    fn told(&self, name: &str) {
        let z = (self.standardised.iter().map(|z| z * z).sum::<f64>() / self.standardised.len().max(1) as f64).sqrt();
        eprintln!(
            "{name}: {}/{} corners, rms {:.4} px, worst {:.3}, mean ({:.4}, {:.4}), error over sigma {z:.2}",
            self.px.len(),
            self.possible,
            self.rms_px(),
            self.worst_px(),
            self.mean_px()[0],
            self.mean_px()[1]
        );
    }
}

#[test]
fn precise_corners_are_many_times_nearer_to_the_truth() {
    let mut all: [Errors; 4] = Default::default();
    for seed in [11, 12] {
        let mut cell = parse_cell(&read("cells/sim.yaml"), "cells/sim.yaml").unwrap();
        if let Some(sim) = &mut cell.sim {
            sim.seed = seed;
        }
        let trajectory = parse_trajectory(&read("trajectories/paper-39.yaml"), "paper-39.yaml").unwrap();
        let plan = plan::expand(&cell, &[(PoseKind::Intrinsics, trajectory)]).unwrap();
        let sim = SimCell::start(&cell, None, f64::INFINITY).unwrap();
        let (scene, placement) = (sim.scene(), sim.truth.placement);
        let board = &cell.board;
        let look = |(i, pose): (usize, &plan::PlannedPose)| {
            let base_from_flange: Transform<Base, Flange> = pose.base_from_tcp * cell.robot.tcp_offset.inverse();
            let (start_s, rgb) = (3.7 * i as f64, placement.rgb_from_target(base_from_flange));
            let event = placement.event_from_target(base_from_flange);
            let (mut fired, mut answered) = (LastPolarity::new(1280, 720), Answered::new(1280, 720, None));
            for e in scene.events(&event, start_s, start_s + 0.1) {
                fired.add(&e);
                answered.event(e);
            }
            let image = scene.expose(&rgb, start_s, 0.0999);
            let frame = vision::frame_view(board, &image).unwrap();
            let events = vision::event_view(board, &fired.image()).unwrap();
            let better = precise::frame_view(board, &image).unwrap();
            let better_events = precise::event_view(board, &answered.image()).unwrap();
            ([frame, better, events, better_events], rgb, event)
        };
        let seen: Vec<_> = plan.poses.par_iter().enumerate().map(look).collect();
        for (views, rgb, event) in &seen {
            for (i, view) in views.iter().enumerate() {
                all[i].add(view, |id| {
                    let corner = board.corner(id)?;
                    if i < 2 { scene.project_rgb(rgb, corner) } else { scene.project_event(event, corner) }
                });
            }
        }
    }
    let [frame, better_frame, events, better_events] = all;
    frame.told("frame, paper");
    better_frame.told("frame, precise");
    events.told("events, paper");
    better_events.told("events, precise");
    assert!(better_events.rms_px() <= 0.25 * events.rms_px());
    assert!(better_events.px.len() as f64 >= 0.99 * better_events.possible as f64);
    assert!(better_frame.rms_px() <= 0.5 * frame.rms_px());
    assert!(better_frame.px.len() as f64 >= 0.99 * better_frame.possible as f64);
}
