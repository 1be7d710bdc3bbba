//! Keeps a layer of Mesa's from looking for Wayland in vain, and from saying so each time.
//!
//! wgpu asks for Wayland surfaces in every Vulkan instance, whatever the display is. Mesa's `VK_LAYER_MESA_device_select`,
//! which puts the display's own card first, takes that for a Wayland session and tries to join it twice for each list of
//! adapters. Without a usable `XDG_RUNTIME_DIR`, libwayland then writes `error: XDG_RUNTIME_DIR is invalid or not set in the
//! environment.` past every log. Nothing but the environment switches the layer off, and changing one's own is unsafe: the
//! program takes its own place, with one variable more.

use std::ffi::OsString;
use std::path::Path;

/// Switches the layer off, by its own name for that.
const SWITCH: &str = "NODEVICE_SELECT";
/// Where Wayland is, if it is anywhere.
const WAYLAND: [&str; 2] = ["WAYLAND_DISPLAY", "WAYLAND_SOCKET"];
/// What a person sets to control the layer, which is then needed.
const CHOICES: [&str; 2] = ["MESA_VK_DEVICE_SELECT", "DRI_PRIME"];

/// Starts the program again without the layer where that would look in vain; to be called before anything else is done.
/// Returns where nothing is in vain, or the program cannot be started again.
pub(super) fn settle() {
    if cfg!(target_os = "linux") && is_in_vain(|name| std::env::var_os(name)) {
        let reason = start_again();
        tracing::debug!("the layer that looks for Wayland stays: {reason}");
    }
}

/// Whether nothing indicates Wayland, which the layer cannot even look for, and nothing asks for the layer.
fn is_in_vain(variable: impl Fn(&str) -> Option<OsString>) -> bool {
    let is_set = |name: &&str| variable(name).is_some_and(|value| !value.is_empty());
    let is_usable = |folder: OsString| Path::new(&folder).is_absolute();
    let mut needs = WAYLAND.iter().chain(&CHOICES).chain([&SWITCH]);
    !needs.any(is_set) && !variable("XDG_RUNTIME_DIR").is_some_and(is_usable)
}

/// Takes the place of this process; returns why that failed.
#[cfg(unix)]
fn start_again() -> std::io::Error {
    use std::os::unix::process::CommandExt as _;

    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(error) => return error,
    };
    let mut arguments = std::env::args_os();
    let mut again = std::process::Command::new(&program);
    again.arg0(arguments.next().unwrap_or(program.into()));
    again.args(arguments).env(SWITCH, "1").exec()
}

#[cfg(not(unix))]
fn start_again() -> std::io::Error {
    std::io::ErrorKind::Unsupported.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_layer_is_left_alone_where_it_can_find_wayland_or_is_asked_for() {
        let in_vain = |set: &[(&str, &str)]| {
            is_in_vain(|name| {
                let mut set = set.iter();
                set.find(|(other, _)| *other == name)
                    .map(|(_, value)| OsString::from(value))
            })
        };
        assert!(in_vain(&[]), "a plain X session");
        assert!(in_vain(&[("XDG_RUNTIME_DIR", "")]));
        assert!(in_vain(&[("XDG_RUNTIME_DIR", "run"), ("DRI_PRIME", "")]));
        for set in [
            ("XDG_RUNTIME_DIR", "/run/user/1000"),
            ("WAYLAND_DISPLAY", "wayland-0"),
            ("WAYLAND_SOCKET", "3"),
            ("MESA_VK_DEVICE_SELECT", "10005:0"),
            ("DRI_PRIME", "1"),
            ("NODEVICE_SELECT", "1"),
        ] {
            assert!(!in_vain(&[set]), "{set:?}");
        }
    }
}
