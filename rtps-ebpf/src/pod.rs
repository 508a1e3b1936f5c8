//! Lets aya copy the ABI's structs into and out of maps; feature `object`.
#![expect(unsafe_code, reason = "`aya::Pod` is an unsafe marker trait")]

use crate::{
    SlotSet,
    abi::{
        Announcement, AnnouncementKey, App, Bell, BuiltinWriter, Config, Destination, Domain,
        FanOut, FanOutKey, Interface, Peer, PortConfig, RecordHeader, Sample, SampleKey, Sender,
    },
};

macro_rules! pod {
    ($($type:ty),+ $(,)?) => {
        $(
            // SAFETY: `repr(C)`, integers and byte arrays only, and asserted to have no padding.
            unsafe impl aya::Pod for $type {}
        )+
    };
}

pod!(
    Announcement,
    AnnouncementKey,
    App,
    Bell,
    BuiltinWriter,
    Config,
    Destination,
    Domain,
    FanOut,
    FanOutKey,
    Interface,
    Peer,
    PortConfig,
    RecordHeader,
    Sample,
    SampleKey,
    Sender,
    SlotSet
);
