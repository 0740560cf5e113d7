//! A display that does not blink as the cell says fails the pre-flight, in words, before anything moves.

use std::path::Path;

use crate::support::{cellcal, stderr, text};

/// What a run of the simulated cell says with this about its display; it must end before it moves.
fn refused(display: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let cell = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    assert!(cell.contains("sim: {seed: 1}"), "cells/sim.yaml has changed");
    let cell = cell.replace("sim: {seed: 1}", &format!("sim: {{seed: 1, display: {{{display}}}}}"));
    let cell = cell.replace("../trajectories", text(&root.join("trajectories")));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cell.yaml");
    std::fs::write(&path, cell).unwrap();
    let output = cellcal(&["run", text(&path), "--time-scale", "max", "-o", text(folder.path())]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(6), "{display}: {said}");
    assert!(said.contains("pre-flight failed; the arm has not been moved"), "{display}: {said}");
    said
}

#[test]
fn a_display_that_is_frozen_or_off_is_not_visible() {
    for display in ["frozen: true", "off: true"] {
        let said = refused(display);
        assert!(said.contains("the event camera sees no blinking display"), "{display}: {said}");
    }
}

#[test]
fn a_display_at_the_wrong_rate_is_told_with_both_rates() {
    let said = refused("actual_cycle_hz: 12.5");
    assert!(said.contains("the display blinks at 12.5") && said.contains("the cell says 15 Hz"), "{said}");
    assert!(said.contains("display.cycle_hz"), "{said}");
}
