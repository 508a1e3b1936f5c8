//! Where an entity can be reached: transport kind, port, address (RTPS 2.5 sections 9.3.2.3 and 9.4.2.10).

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use serde::{Deserialize, Serialize};

use super::{Cursor, WireError};

/// The transport of a [`Locator`].
#[derive(Clone, Copy, Debug, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize)]
pub struct LocatorKind(pub i32);

impl LocatorKind {
    /// LOCATOR_KIND_INVALID.
    pub const INVALID: Self = Self(-1);
    /// UDP over IPv4.
    pub const UDP_V4: Self = Self(1);
    /// UDP over IPv6.
    pub const UDP_V6: Self = Self(2);
}

/// A transport address as the wire carries it: 24 bytes.
#[derive(Clone, Copy, Debug, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize)]
pub struct Locator {
    /// The transport; vendors have kinds of their own (shared memory, TCP), which we skip.
    pub kind: LocatorKind,
    /// The UDP port.
    pub port: u32,
    /// The IPv6 address, or 12 zero bytes and the IPv4 address.
    pub address: [u8; 16],
}

impl Locator {
    /// The socket address, where the transport is UDP and the port a real one.
    pub fn to_socket_addr(self) -> Option<SocketAddr> {
        let port = u16::try_from(self.port).ok().filter(|port| *port != 0)?;
        let ip = match self.kind {
            LocatorKind::UDP_V4 => {
                let [.., a, b, c, d] = self.address;
                IpAddr::V4(Ipv4Addr::new(a, b, c, d))
            }
            LocatorKind::UDP_V6 => IpAddr::V6(Ipv6Addr::from(self.address)),
            _ => return None,
        };
        Some(SocketAddr::new(ip, port))
    }

    /// Reads kind, port and address.
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        Ok(Self {
            kind: LocatorKind(cursor.i32()?),
            port: cursor.u32()?,
            address: cursor.array()?,
        })
    }

    /// Writes kind, port and address, little endian.
    pub fn encode(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.kind.0.to_le_bytes());
        out.extend_from_slice(&self.port.to_le_bytes());
        out.extend_from_slice(&self.address);
    }
}

impl From<SocketAddr> for Locator {
    fn from(addr: SocketAddr) -> Self {
        let (kind, address) = match addr.ip() {
            IpAddr::V4(ip) => {
                let mut address = [0; 16];
                address[12..].copy_from_slice(&ip.octets());
                (LocatorKind::UDP_V4, address)
            }
            IpAddr::V6(ip) => (LocatorKind::UDP_V6, ip.octets()),
        };
        Self {
            kind,
            port: u32::from(addr.port()),
            address,
        }
    }
}

impl fmt::Display for Locator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.to_socket_addr() {
            Some(addr) => addr.fmt(f),
            None => write!(f, "locator of kind {}", self.kind.0),
        }
    }
}
