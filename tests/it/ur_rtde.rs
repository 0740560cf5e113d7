//! The simulated controller with a client that we did not write: `ur-rtde` from PyPI, unmodified.
//!
//! `CELLCAL_UR_RTDE_PYTHON` names a python that has `ur-rtde` 1.6 (`pip install ur-rtde==1.6.5`).

use std::net::IpAddr;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use cellcal::devices::sim::ur::{Ports, SimController, SimUrConfig};

/// The client has fixed ports, so nobody else may use them here; on 127.0.0.1 it skips a check.
const ADDRESS: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(127, 0, 0, 8));

#[test]
fn the_client_of_others_works() {
    let Some(python) = std::env::var_os("CELLCAL_UR_RTDE_PYTHON") else {
        eprintln!("skipped: CELLCAL_UR_RTDE_PYTHON is not set, so there is no ur-rtde to test with");
        return;
    };
    assert!(Path::new(&python).exists(), "CELLCAL_UR_RTDE_PYTHON is set, but {} does not exist", python.display());
    // It knows nothing of lock-step.
    let config = SimUrConfig {
        address: ADDRESS,
        ports: Ports::REAL,
        time_scale: 1.0,
        lock_step_patience: Duration::ZERO,
        tcp_offset: [0.02, -0.03, 0.15, 0.1, 0.2, 0.0],
        ..SimUrConfig::default()
    };
    let sim = SimController::start(config, 1).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/clients/ur_rtde_client.py");
    let output = Command::new(&python).arg(&script).arg(sim.address().to_string()).output().unwrap();
    let (said, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{}\n{said}\n{errors}", output.status);
    let checks = said.lines().filter(|line| line.contains(" ok ")).count();
    assert!(checks > 150, "only {checks} checks:\n{said}");
}
