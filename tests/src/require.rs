//! What a test requires of the machine. A test that cannot run says why and is skipped:
//!
//! ```no_run
//! # fn test() -> anyhow::Result<()> {
//! rtps_tests::skip_unless!(rtps_tests::require::root());
//! # Ok(())
//! # }
//! ```

use nix::sys::utsname::uname;
use nix::unistd::Uid;

/// Root in the initial user namespace: namespaces, veth pairs and BPF need it.
///
/// # Errors
/// The reason why the test is skipped.
pub fn root() -> Result<(), String> {
    if Uid::effective().is_root() {
        Ok(())
    } else {
        Err("it needs root (network namespaces, BPF)".to_owned())
    }
}

/// A kernel of at least this version.
///
/// # Errors
/// The reason why the test is skipped.
pub fn kernel(major: u32, minor: u32) -> Result<(), String> {
    let name = uname().map_err(|error| format!("uname failed: {error}"))?;
    let release = name.release().to_string_lossy().into_owned();
    match parse_release(&release) {
        Some(version) if version >= (major, minor) => Ok(()),
        _ => Err(format!(
            "it needs kernel {major}.{minor}, this is {release}"
        )),
    }
}

fn parse_release(release: &str) -> Option<(u32, u32)> {
    let mut numbers = release.split(|c: char| !c.is_ascii_digit());
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

/// Returns `Ok(())` from the test, with the reason on standard error, unless the requirement is met.
#[macro_export]
macro_rules! skip_unless {
    ($requirement:expr) => {
        if let Err(reason) = $requirement {
            eprintln!("skipped: {reason}");
            return Ok(());
        }
    };
}

#[cfg(test)]
mod tests {
    use super::parse_release;

    #[test]
    fn releases() {
        assert_eq!(parse_release("6.18.44-fc"), Some((6, 18)));
        assert_eq!(parse_release("6.1.0-13-cloud-amd64"), Some((6, 1)));
        assert_eq!(parse_release("unknown"), None);
    }
}
