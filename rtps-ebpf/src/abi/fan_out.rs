//! Fan-out: what an app sends once, and the kernel to several destinations.

/// Where an app sends what is for several destinations; the UDP port is the number of one of its lists, and below
/// those that a process without privileges can open. Nobody has the address, so that an app hears of an absent
/// program by the ICMP error.
pub const FAN_OUT_ADDRESS: [u8; 4] = [127, 82, 84, 80];
/// Lists of one app, numbered from 1.
pub const FAN_OUTS_PER_APP: u8 = 16;
/// Lists of all apps.
pub const FAN_OUTS: u32 = super::SLOTS * FAN_OUTS_PER_APP as u32;
/// Destinations of one list.
pub const FAN_OUT_DESTINATIONS: usize = 64;

/// `senders`: the app whose socket may send to [`FAN_OUT_ADDRESS`]; the key is the socket's cookie.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sender {
    /// The app's slot, in the name of whose entities the socket speaks.
    pub slot: u32,
    /// Index into `domains`.
    pub domain_index: u32,
}

/// `fan_outs`: whose list it is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct FanOutKey {
    /// The app's slot.
    pub slot: u32,
    /// 1 to [`FAN_OUTS_PER_APP`].
    pub number: u32,
}

/// `fan_outs`: a list of destinations.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FanOut {
    /// How many there are, 1 to [`FAN_OUT_DESTINATIONS`].
    pub count: u32,
    /// Zero.
    pub reserved: u32,
    /// These, then zeros.
    pub destinations: [Destination; FAN_OUT_DESTINATIONS],
}

/// One destination, and the way to it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Destination {
    /// IPv4 address to send from, in network order.
    pub source: [u8; 4],
    /// IPv4 address to send to, in network order.
    pub address: [u8; 4],
    /// UDP port (host order).
    pub port: u32,
    /// The interface that leads there.
    pub ifindex: u32,
}

const _: () = {
    assert!(size_of::<Sender>() == 8);
    assert!(size_of::<FanOutKey>() == 8);
    assert!(size_of::<Destination>() == 16);
    assert!(size_of::<FanOut>() == 8 + 16 * FAN_OUT_DESTINATIONS);
};
