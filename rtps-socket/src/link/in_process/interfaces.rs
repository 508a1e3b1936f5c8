//! The interfaces that the in-process layer uses: all that are up and have an address, as of now.

use std::io;

use rtps_net::Interface;

/// Names of the interfaces to use, separated by commas; all that are up where it is not set.
const CHOICE_VARIABLE: &str = "RTPS_INTERFACES";

/// The interfaces that are up and that the environment does not exclude.
pub(super) fn chosen() -> io::Result<Vec<Interface>> {
    let choice = std::env::var(CHOICE_VARIABLE).ok();
    let mut interfaces = rtps_net::all_up()?;
    interfaces.retain(|interface| is_chosen(choice.as_deref(), &interface.name));
    Ok(interfaces)
}

fn is_chosen(choice: Option<&str>, name: &str) -> bool {
    choice.is_none_or(|names| names.split(',').any(|one| one.trim() == name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfaces_are_chosen_by_name() {
        assert!(is_chosen(None, "lo"));
        assert!(is_chosen(Some("nosuch0, lo"), "lo"));
        assert!(!is_chosen(Some("nosuch0"), "lo"));
        assert!(!is_chosen(Some("lo0"), "lo"));
    }
}
