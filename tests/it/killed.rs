//! The program dies in the middle of a move: the controller stops the arm by itself.

use std::net::{IpAddr, SocketAddr};
use std::process::{Child, Command, Stdio};

use cellcal::devices::rtde::Value;

use crate::bench::rtde_client::Watcher;

/// A process that ends with the test.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn spawn(arguments: &[&str]) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cellcal"));
    let command = command.current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments);
    Ended(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
}

/// One cycle of the controller.
#[derive(Debug, Clone, Copy)]
struct Cycle {
    at_s: f64,
    heartbeat: i32,
    playing: bool,
    aimed_rad_s: f64,
    measured_rad_s: f64,
}

fn next(watcher: &mut Watcher) -> Cycle {
    let fastest = |q: &[f64; 6]| q.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    match watcher.next().as_slice() {
        [
            Value::Double(at_s),
            Value::Int32(heartbeat),
            Value::Uint32(runtime),
            Value::Vector6d(aimed),
            Value::Vector6d(measured),
        ] => Cycle {
            at_s: *at_s,
            heartbeat: *heartbeat,
            playing: *runtime == 2,
            aimed_rad_s: fastest(aimed),
            measured_rad_s: fastest(measured),
        },
        other => panic!("{other:?}"),
    }
}

#[test]
fn kill_9_in_the_middle_of_a_move_stops_the_arm() {
    let host: IpAddr = "127.0.0.31".parse().unwrap();
    let folder = tempfile::tempdir().unwrap();
    // The shipped cell, with the driver of the real arm at the address of the simulated controller.
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    let trajectories = root.join("trajectories").display().to_string();
    let text = text.replacen("driver: sim", &format!("driver: ur\n  address: {host}"), 1);
    // Nobody sits at a terminal here, so an interlock must release the cell.
    let released = "  interlocks: [{digital_input: 0, must_be: false, meaning: cell released}]\n  limits:\n";
    let text = text.replacen("  limits:\n", released, 1);
    let text = text.replace("../trajectories", &trajectories);
    let cell = folder.path().join("cell.yaml");
    std::fs::write(&cell, text).unwrap();
    let cell = cell.to_str().unwrap();

    let _controller = spawn(&["sim", "ur", "--host", &host.to_string(), "--cell", cell]);
    let fields = ["timestamp", "input_int_register_24", "runtime_state", "target_qd", "actual_qd"];
    let mut watcher = Watcher::connect(SocketAddr::new(host, 30004), &fields);
    let output = folder.path().join("sessions");
    let session = spawn(&["run", cell, "--rehearse", "--output", output.to_str().unwrap()]);
    // In the middle of the second of cruising: 60 s of controller time must be enough to get there.
    let first = next(&mut watcher);
    let mut fast = 0;
    let moving = loop {
        let cycle = next(&mut watcher);
        assert!(cycle.at_s - first.at_s < 60.0, "the arm does not move");
        fast = if cycle.playing && cycle.aimed_rad_s > 0.2 { fast + 1 } else { 0 };
        if fast >= 20 {
            break cycle;
        }
    };
    drop(session);
    let (mut last_beat, mut stopped, mut at_rest) = (moving, None, None);
    while at_rest.is_none() {
        let cycle = next(&mut watcher);
        assert!(cycle.at_s - moving.at_s < 5.0, "the arm is not stopped: {cycle:?}");
        if cycle.heartbeat != last_beat.heartbeat {
            last_beat = cycle;
        }
        if stopped.is_none() && !cycle.playing {
            stopped = Some(cycle.at_s);
        }
        if stopped.is_some() && cycle.aimed_rad_s == 0.0 {
            at_rest = Some(cycle.at_s);
        }
    }
    let after = |at_s: Option<f64>| at_s.unwrap() - last_beat.at_s;
    assert!(after(stopped) <= 0.15, "program stopped {:.3} s after the last package", after(stopped));
    assert!(after(at_rest) <= 0.30, "arm at rest {:.3} s after the last package", after(at_rest));
    // And it stays there, once the ringing is over.
    let until_s = at_rest.unwrap() + 2.0;
    let mut measured = f64::INFINITY;
    loop {
        let cycle = next(&mut watcher);
        assert!(!cycle.playing && cycle.aimed_rad_s == 0.0, "{cycle:?}");
        if cycle.at_s > until_s {
            break;
        }
        measured = cycle.measured_rad_s;
    }
    assert!(measured < 0.005, "{measured} rad/s after 2 s");
}
