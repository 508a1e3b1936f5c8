//! Which hook takes messages for apps from an interface.

use std::fmt;

use rtps_net::Interface;
use serde::{Deserialize, Serialize};

use super::XdpHook;

/// Where messages for apps are to be taken from an interface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum WantedMode {
    /// tc on a veth, which has XDP take apart what comes in one piece; elsewhere native XDP where the driver can, else
    /// generic XDP.
    #[default]
    Auto,
    /// XDP, run by the driver, before the kernel allocates anything; an error where it cannot.
    Native,
    /// XDP, run by the network stack; works on every interface.
    Generic,
    /// tc, behind XDP, where several datagrams still come as one; an error where it cannot be.
    Tc,
}

/// The mode that took effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AttachedMode {
    /// XDP, run by the driver.
    Native,
    /// XDP, run by the network stack.
    Generic,
    /// tc.
    Tc,
}

impl WantedMode {
    /// What to try on an interface, in this order.
    pub(super) fn attempts(self, interface: &Interface) -> &'static [AttachedMode] {
        use AttachedMode::{Generic, Native, Tc};
        match self {
            Self::Auto if interface.is_veth() => &[Tc, Native, Generic],
            Self::Auto => &[Native, Generic],
            Self::Native => &[Native],
            Self::Generic => &[Generic],
            Self::Tc => &[Tc],
        }
    }
}

impl AttachedMode {
    /// Its name in JSON and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Native => XdpHook::Native.name(),
            Self::Generic => XdpHook::Generic.name(),
            Self::Tc => "tc",
        }
    }

    pub(super) fn xdp(self) -> Option<XdpHook> {
        match self {
            Self::Native => Some(XdpHook::Native),
            Self::Generic => Some(XdpHook::Generic),
            Self::Tc => None,
        }
    }
}

impl From<XdpHook> for AttachedMode {
    fn from(hook: XdpHook) -> Self {
        match hook {
            XdpHook::Native => Self::Native,
            XdpHook::Generic => Self::Generic,
        }
    }
}

impl fmt::Display for AttachedMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
