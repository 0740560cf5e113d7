//! Tells `src/cv` which OpenCV it is built against: since 4.7 the module `objdetect` finds markers and boards,
//! before that a contributed module did, with other functions.

use std::process::Command;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(markers_in_objdetect)");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=PKG_CONFIG_PATH");
    // Another OpenCV in the same place is another file.
    if let Ok(folder) = pkg_config(&["--variable=pcfiledir", "opencv4"]) {
        println!("cargo::rerun-if-changed={folder}/opencv4.pc");
    }
    match pkg_config(&["--modversion", "opencv4"]).and_then(|version| markers_in_objdetect(&version)) {
        Ok(true) => println!("cargo::rustc-cfg=markers_in_objdetect"),
        Ok(false) => {}
        Err(why) => println!("cargo::error={why}; install libopencv-dev and pkg-config"),
    }
}

/// What `pkg-config` answers.
fn pkg_config(arguments: &[&str]) -> Result<String, String> {
    let asked = format!("pkg-config {}", arguments.join(" "));
    let output = Command::new("pkg-config").args(arguments).output().map_err(|why| format!("{asked}: {why}"))?;
    if !output.status.success() {
        return Err(format!("{asked} knows no OpenCV"));
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

fn markers_in_objdetect(version: &str) -> Result<bool, String> {
    let numbers: Vec<u32> = version.split('.').map_while(|part| part.parse().ok()).collect();
    match numbers.as_slice() {
        [major, minor, ..] => Ok((*major, *minor) >= (4, 7)),
        [] | [_] => Err(format!("OpenCV says that its version is {version}, not such as 4.6.0")),
    }
}
