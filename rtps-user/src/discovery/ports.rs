//! The well-known ports of a domain (RTPS 2.5 section 9.6.2).

use thiserror::Error;

const PORT_BASE: u32 = 7400;
const DOMAIN_GAIN: u32 = 250;
const PARTICIPANT_GAIN: u32 = 2;
const METATRAFFIC_MULTICAST_OFFSET: u32 = 0;
const METATRAFFIC_UNICAST_OFFSET: u32 = 10;
const USER_MULTICAST_OFFSET: u32 = 1;
const USER_UNICAST_OFFSET: u32 = 11;

/// The ports of one participant of a domain.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Ports {
    /// Announcements to the group; shared by all participants of the domain.
    pub metatraffic_multicast: u16,
    /// Discovery traffic for this participant.
    pub metatraffic_unicast: u16,
    /// Samples to a group; shared by all participants of the domain.
    pub user_multicast: u16,
    /// Samples for this participant.
    pub user_unicast: u16,
}

/// The formula leaves the range of ports.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
#[error("domain {domain} has no ports for participant {participant}: use a domain of at most 232")]
pub struct NoPort {
    /// The domain asked for.
    pub domain: u32,
    /// The participant asked for.
    pub participant: u32,
}

impl Ports {
    /// The ports of the participant with the given id, counted from 0 on each host.
    pub fn new(domain: u32, participant: u32) -> Result<Self, NoPort> {
        let no_port = NoPort {
            domain,
            participant,
        };
        let port = |participant: u32, offset: u32| {
            let in_domain = participant
                .checked_mul(PARTICIPANT_GAIN)?
                .checked_add(offset)?;
            let port = domain
                .checked_mul(DOMAIN_GAIN)?
                .checked_add(PORT_BASE)?
                .checked_add(in_domain)?;
            u16::try_from(port).ok()
        };
        Ok(Self {
            metatraffic_multicast: port(0, METATRAFFIC_MULTICAST_OFFSET).ok_or(no_port)?,
            metatraffic_unicast: port(participant, METATRAFFIC_UNICAST_OFFSET).ok_or(no_port)?,
            user_multicast: port(0, USER_MULTICAST_OFFSET).ok_or(no_port)?,
            user_unicast: port(participant, USER_UNICAST_OFFSET).ok_or(no_port)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_participants() {
        let ports = |domain, participant| {
            let ports = Ports::new(domain, participant).unwrap();
            [
                ports.metatraffic_multicast,
                ports.metatraffic_unicast,
                ports.user_multicast,
                ports.user_unicast,
            ]
        };
        assert_eq!(ports(0, 0), [7400, 7410, 7401, 7411]);
        assert_eq!(ports(0, 3), [7400, 7416, 7401, 7417]);
        assert_eq!(ports(7, 1), [9150, 9162, 9151, 9163]);
    }

    #[test]
    fn beyond_the_last_port() {
        assert!(Ports::new(232, 59).is_ok());
        assert!(Ports::new(233, 0).is_err());
        assert!(Ports::new(0, u32::MAX).is_err());
        assert!(Ports::new(u32::MAX, 0).is_err());
    }
}
