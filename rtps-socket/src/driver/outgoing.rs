//! Gathers datagrams into bursts.

use std::net::SocketAddr;
use std::sync::Arc;

use rtps_user::Transmit;

use crate::link::Burst;

/// Datagrams for the same destinations that have not been sent yet.
#[derive(Debug)]
pub(super) struct Outgoing {
    destinations: Arc<[SocketAddr]>,
    bytes: Vec<u8>,
    segment: usize,
    dscp: u8,
}

impl Outgoing {
    pub(super) fn new() -> Self {
        Self {
            destinations: Arc::new([]),
            bytes: Vec::new(),
            segment: 0,
            dscp: 0,
        }
    }

    /// Where the next datagram is to be appended.
    pub(super) fn buffer(&mut self) -> &mut Vec<u8> {
        &mut self.bytes
    }

    /// Everything behind `start` was appended, a datagram. What it cannot leave together with is sent before.
    pub(super) fn appended(
        &mut self,
        start: usize,
        transmit: Transmit,
        send: impl FnOnce(&Burst<'_>),
    ) {
        if !self.is_of_burst(start, &transmit) {
            send(&self.burst(start));
            self.bytes.drain(..start);
            self.segment = 0;
        }
        if self.segment == 0 {
            self.segment = self.bytes.len();
            self.destinations = transmit.destinations;
            self.dscp = transmit.dscp;
        }
    }

    /// Sends what is left.
    pub(super) fn flush(&mut self, send: impl FnOnce(&Burst<'_>)) {
        if !self.bytes.is_empty() {
            send(&self.burst(self.bytes.len()));
            self.bytes.clear();
            self.segment = 0;
        }
    }

    /// Whether what is behind `start` can leave together with what is before.
    fn is_of_burst(&self, start: usize, transmit: &Transmit) -> bool {
        let (segment, destinations) = (self.segment, &transmit.destinations);
        segment == 0
            || self.bytes.len() <= Burst::MAX_BYTES.min(segment * Burst::MAX_DATAGRAMS)
                && self.bytes.len() - start <= segment
                && start.is_multiple_of(segment)
                && self.dscp == transmit.dscp
                && (Arc::ptr_eq(&self.destinations, destinations)
                    || self.destinations == *destinations)
    }

    fn burst(&self, end: usize) -> Burst<'_> {
        Burst {
            destinations: &self.destinations,
            bytes: &self.bytes[..end],
            segment: self.segment,
            dscp: self.dscp,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bursts as lists of the lengths of their datagrams, behind the port they go to.
    fn bursts(datagrams: &[(u16, usize)]) -> Vec<(u16, Vec<usize>)> {
        let mut sent = Vec::new();
        let mut outgoing = Outgoing::new();
        let mut send = |burst: &Burst<'_>| {
            let lengths = burst.datagrams().map(<[u8]>::len).collect();
            sent.push((burst.destinations[0].port(), lengths));
        };
        for &(port, len) in datagrams {
            let start = outgoing.buffer().len();
            outgoing.buffer().resize(start + len, 1);
            let transmit = Transmit::to(([127, 0, 0, 1], port).into());
            outgoing.appended(start, transmit, &mut send);
        }
        outgoing.flush(&mut send);
        outgoing.flush(&mut send);
        sent
    }

    #[test]
    fn equal_datagrams_leave_together() {
        assert_eq!(bursts(&[]), []);
        assert_eq!(bursts(&[(1, 10)]), [(1, vec![10])]);
        assert_eq!(bursts(&[(1, 10), (1, 10), (1, 4)]), [(1, vec![10, 10, 4])]);
    }

    #[test]
    fn what_does_not_fit_together_leaves_apart() {
        assert_eq!(
            bursts(&[(1, 10), (2, 10), (2, 10), (2, 11), (2, 4), (2, 4)]),
            [
                (1, vec![10]),
                (2, vec![10, 10]),
                (2, vec![11, 4]),
                (2, vec![4])
            ]
        );
    }

    #[test]
    fn a_burst_is_bounded() {
        let many = bursts(&[(1, 10); 150]);
        let counts: Vec<_> = many.iter().map(|(_, lengths)| lengths.len()).collect();
        assert_eq!(counts, [64, 64, 22]);
        let large = bursts(&[(1, 30_000); 5]);
        let counts: Vec<_> = large.iter().map(|(_, lengths)| lengths.len()).collect();
        assert_eq!(counts, [2, 2, 1]);
    }
}
