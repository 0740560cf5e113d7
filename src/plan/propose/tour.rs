//! In which order: short moves, from home and back.

use rayon::prelude::*;

use super::super::Clearance;
use super::super::motion;
use super::super::stops::Goal;
use super::candidates::Item;
use crate::config::{Cell, Motion, MotionBy};
use crate::geometry::kinematics::{Arm, Joints};

/// Move times between the items of a tour, s; infinite where there is no clear way.
pub(super) struct Times {
    /// From the exit of an item, or from home in the last row, to each item and through it.
    to: Vec<Vec<f64>>,
    /// From the exit of each item to home; zero where the arm stays.
    home: Vec<f64>,
}

impl Times {
    pub(super) fn of(cell: &Cell, arm: &Arm, clearance: &Clearance, items: &[&Item]) -> Self {
        let home_rad = &cell.robot.home_joints_rad;
        let row = |from: &Joints| items.iter().map(|item| enter_s(cell, arm, clearance, from, item)).collect();
        let exits: Vec<Joints> = items.iter().map(|item| item.exit().joints_rad).chain([*home_rad]).collect();
        let to = exits.par_iter().map(row).collect();
        let returns = cell.robot.return_home && cell.robot.motion == MotionBy::Script;
        let back = |item: &&Item| {
            let way = [&item.exit().joints_rad, home_rad];
            motion::joint_move(cell, arm, clearance, way, 1.0).map_or(f64::INFINITY, |home| home.move_s)
        };
        let home = items.par_iter().map(|item| if returns { back(item) } else { 0.0 }).collect();
        Self { to, home }
    }

    /// All moves of a tour, s.
    pub(super) fn moves_s(&self, order: &[usize]) -> f64 {
        let mut from = self.home.len();
        let mut sum_s = 0.0;
        for item in order {
            sum_s += self.to[from][*item];
            from = *item;
        }
        sum_s + order.last().map_or(0.0, |last| self.home[*last])
    }

    /// A short tour through these items: the nearest one next, then bettered by turning stretches round and by
    /// moving stops elsewhere until nothing gains.
    pub(super) fn short_tour(&self, items: &[usize]) -> Vec<usize> {
        let mut order = Vec::new();
        let mut left = items.to_vec();
        let mut from = self.home.len();
        while let Some(at) = (0..left.len()).min_by(|a, b| self.to[from][left[*a]].total_cmp(&self.to[from][left[*b]]))
        {
            from = left.remove(at);
            order.push(from);
        }
        while let Some(better) = self.bettered(&order) {
            order = better;
        }
        order
    }

    /// The best tour that one change makes, if it is shorter.
    fn bettered(&self, order: &[usize]) -> Option<Vec<usize>> {
        let now_s = self.moves_s(order);
        let mut best: Option<(f64, Vec<usize>)> = None;
        for i in 0..order.len() {
            for k in 0..order.len() {
                let mut changed = order.to_vec();
                if i < k {
                    changed[i..=k].reverse();
                } else {
                    let stop = changed.remove(i);
                    changed.insert(k, stop);
                }
                let time_s = self.moves_s(&changed);
                let shorter = best.as_ref().map_or(now_s - 1e-9, |b| b.0);
                if time_s < shorter {
                    best = Some((time_s, changed));
                }
            }
        }
        best.map(|(_, order)| order)
    }
}

/// To an item and, for a pair, on to its second stop.
fn enter_s(cell: &Cell, arm: &Arm, clearance: &Clearance, from: &Joints, item: &Item) -> f64 {
    let Some((_, _, inner_s)) = &item.second else {
        let way = [from, &item.first.joints_rad];
        return motion::joint_move(cell, arm, clearance, way, 1.0).map_or(f64::INFINITY, |planned| planned.move_s);
    };
    // Both stops of a pair are approached on a straight line.
    let goal = Goal::Tcp(item.first.base_from_tcp);
    let leg = motion::leg(cell, arm, clearance, from, &goal, Motion::Linear);
    leg.map_or(f64::INFINITY, |leg| leg.duration_s + inner_s)
}
