//! What the integration tests share: running the program, finding the recordings, reading results.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The folder of real recordings; `None` with a printed reason where `CELLCAL_DATA` is unset.
///
/// Set and absent is a failure.
pub(crate) fn data(of: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("CELLCAL_DATA") else {
        eprintln!("skipped: CELLCAL_DATA is not set, so {of} is not there to test with");
        return None;
    };
    let folder = Path::new(&root).join(of);
    assert!(folder.exists(), "CELLCAL_DATA is set, but {} does not exist", folder.display());
    Some(folder)
}

/// Runs the program in the root of the checkout.
pub(crate) fn cellcal(arguments: &[&str]) -> Output {
    let root = env!("CARGO_MANIFEST_DIR");
    Command::new(env!("CARGO_BIN_EXE_cellcal")).current_dir(root).args(arguments).output().unwrap()
}

/// Runs the program and expects this exit code.
pub(crate) fn expect(code: i32, arguments: &[&str]) -> Output {
    let output = cellcal(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "cellcal {arguments:?}:\n{stderr}");
    output
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stdout)))
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A number of the result by its path, such as `/cameras/rgb/fx`.
pub(crate) fn number(result: &Value, pointer: &str) -> f64 {
    result.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} is not in {result:#}"))
}

/// Three numbers of the result.
pub(crate) fn vector(result: &Value, pointer: &str) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::from_fn(|i, _| number(result, &format!("{pointer}/{i}")))
}

/// A quaternion of the result (x, y, z, w).
pub(crate) fn rotation(result: &Value, pointer: &str) -> nalgebra::UnitQuaternion<f64> {
    let [x, y, z, w] = [0, 1, 2, 3].map(|i| number(result, &format!("{pointer}/{i}")));
    nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
}
