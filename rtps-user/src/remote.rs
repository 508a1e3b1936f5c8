//! What discovery tells an endpoint of a matched remote one.

use std::net::{IpAddr, SocketAddr};

use serde::{Deserialize, Serialize};

use crate::qos::{ContentFilter, Qos};
use crate::wire::Guid;

/// A remote endpoint that a local one is matched with.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct RemoteEndpoint {
    /// Its name.
    pub guid: Guid,
    /// Where to send what is for it, best first: its own unicast locators or its participant's default ones,
    /// those that we can reach; one of them is enough. Of another app of this host it may be a [`local`](crate::local)
    /// one.
    pub unicast: Vec<SocketAddr>,
    /// Where its datagrams may come from: what others send in its name is not taken. Empty where that is not checked,
    /// between endpoints of one host.
    pub addresses: Vec<IpAddr>,
    /// Multicast groups that it listens to.
    pub multicast: Vec<SocketAddr>,
    /// A reader that wants inline QoS with each sample.
    pub expects_inline_qos: bool,
    /// A reader that takes keys in XCDR2 without DHEADERs: of Cyclone DDS 0.10.
    pub takes_bare_keys: bool,
    /// Its policies.
    pub qos: Qos,
    /// The topic that it is matched on.
    pub topic: String,
    /// Its type.
    pub type_name: String,
    /// TypeInformation of its type as it is serialized (XTypes 1.3 section 7.6.3.2.1); empty where it says nothing.
    pub type_information: Vec<u8>,
    /// What a reader wants of the topic, if not all.
    pub content_filter: Option<ContentFilter>,
}
