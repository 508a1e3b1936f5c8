//! What people and tools see of the layer.

use std::net::SocketAddr;

use serde::Serialize;

use super::Layer;
use super::apps::App;
use crate::RemoteEndpoint;
use crate::discovery::{Refused, RemoteParticipant};
use crate::qos::Qos;
use crate::wire::Guid;

/// A snapshot of what the layer knows.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LayerStatus {
    /// The DDS domain.
    pub domain: u32,
    /// The GUID prefix of the host's participant, in hexadecimal.
    pub prefix: String,
    /// Remote participants.
    pub participants: Vec<ParticipantStatus>,
    /// Apps that use the layer.
    pub apps: Vec<AppStatus>,
    /// What was refused.
    pub refused: RefusedStatus,
}

/// A remote participant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParticipantStatus {
    /// Its GUID prefix, in hexadecimal.
    pub prefix: String,
    /// Its name, if it says one.
    pub name: String,
    /// Its vendor's number, in hexadecimal.
    pub vendor: String,
    /// Where discovery traffic for it goes.
    pub metatraffic: Vec<SocketAddr>,
    /// Where samples for its endpoints go, best first, unless an endpoint says otherwise.
    pub user: Vec<SocketAddr>,
    /// Its lease in seconds; none where it never ends.
    pub lease_seconds: Option<f64>,
    /// Its endpoints.
    pub endpoints: Vec<EndpointStatus>,
}

/// An app.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AppStatus {
    /// Its slot.
    pub slot: u8,
    /// The name that it gave.
    pub name: String,
    /// False between a restart of the layer and the return of the app.
    pub attached: bool,
    /// Its endpoints.
    pub endpoints: Vec<EndpointStatus>,
}

/// An endpoint.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EndpointStatus {
    /// Its GUID, in hexadecimal.
    pub guid: String,
    /// "writer" or "reader".
    pub kind: &'static str,
    /// Its topic.
    pub topic: String,
    /// Its type's name.
    pub type_name: String,
    /// Its policies.
    pub qos: Qos,
    /// GUIDs of the endpoints that it is matched with.
    pub matched: Vec<String>,
}

/// Counts of what was not taken.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, Serialize)]
pub struct RefusedStatus {
    /// Announcements of participants that the table had no room for.
    pub participants: u64,
    /// Endpoints that the table had no room for.
    pub endpoints: u64,
    /// Discovery samples that could not be read.
    pub malformed: u64,
    /// Submessages that came from an address that is not their participant's.
    pub foreign: u64,
}

impl Layer {
    /// What the layer knows.
    pub fn status(&self) -> LayerStatus {
        LayerStatus {
            domain: self.config.domain,
            prefix: self.config.prefix.to_string(),
            participants: self
                .discovery
                .participants()
                .map(|participant| self.participant_status(participant))
                .collect(),
            apps: self
                .apps
                .iter()
                .map(|(slot, app)| self.app_status(slot, app))
                .collect(),
            refused: self.discovery.refused().into(),
        }
    }

    fn app_status(&self, slot: u8, app: &App) -> AppStatus {
        let guids = app.endpoints.keys();
        let guids = guids.map(|entity| Guid::new(self.config.prefix, *entity));
        AppStatus {
            slot,
            name: app.name.clone(),
            attached: app.backlog.is_none(),
            endpoints: guids
                .filter_map(|guid| self.matchmaker.endpoint(guid))
                .map(|endpoint| {
                    let matches = self.matchmaker.matches_of(endpoint.guid.entity);
                    EndpointStatus::new(endpoint, matches.map(|guid| guid.to_string()))
                })
                .collect(),
        }
    }

    fn participant_status(&self, participant: &RemoteParticipant) -> ParticipantStatus {
        let own = self.config.prefix;
        ParticipantStatus {
            prefix: participant.data.prefix.to_string(),
            name: participant.data.name.clone(),
            vendor: format!("{:04x}", u16::from_be_bytes(participant.data.vendor.0)),
            metatraffic: participant.metatraffic.clone(),
            user: participant.user.clone(),
            lease_seconds: participant.lease().map(|lease| lease.as_secs_f64()),
            endpoints: participant
                .endpoints
                .keys()
                .filter_map(|entity| participant.endpoint(*entity))
                .map(|endpoint| {
                    let matches = self.matchmaker.matched_with(endpoint.guid);
                    let matches = matches.map(|local| Guid::new(own, local).to_string());
                    EndpointStatus::new(&endpoint, matches)
                })
                .collect(),
        }
    }
}

impl EndpointStatus {
    fn new(endpoint: &RemoteEndpoint, matched: impl Iterator<Item = String>) -> Self {
        let is_writer = endpoint.guid.entity.is_writer();
        Self {
            guid: endpoint.guid.to_string(),
            kind: if is_writer { "writer" } else { "reader" },
            topic: endpoint.topic.clone(),
            type_name: endpoint.type_name.clone(),
            qos: endpoint.qos.clone(),
            matched: matched.collect(),
        }
    }
}

impl From<Refused> for RefusedStatus {
    fn from(refused: Refused) -> Self {
        Self {
            participants: refused.participants,
            endpoints: refused.endpoints,
            malformed: refused.malformed,
            foreign: refused.foreign,
        }
    }
}
