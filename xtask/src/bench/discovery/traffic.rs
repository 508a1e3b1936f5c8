//! What has gone over a link, as the kernel counts it at an interface.

use std::fs;
use std::ops::Sub;

use anyhow::{Context, Result};
use rtps_tests::link::Host;

/// Both directions together. Bytes are those of Ethernet frames without checksum; ARP, IGMP and the like are in it.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Traffic {
    pub(super) packets: u64,
    pub(super) bytes: u64,
}

impl Traffic {
    /// What the host's interface has received and sent so far.
    pub(super) fn of(host: &Host) -> Result<Self> {
        let table = host
            .netns
            .enter(|| fs::read_to_string("/proc/thread-self/net/dev"))?;
        parse(&table, &host.interface.name)
            .with_context(|| format!("the kernel does not count {}", host.interface.name))
    }
}

impl Sub for Traffic {
    type Output = Self;

    fn sub(self, before: Self) -> Self {
        Self {
            packets: self.packets - before.packets,
            bytes: self.bytes - before.bytes,
        }
    }
}

/// A line of /proc/net/dev: eight numbers of reception, then eight of sending, each beginning with bytes and packets.
fn parse(table: &str, interface: &str) -> Option<Traffic> {
    let numbers = table.lines().find_map(|line| {
        let (name, numbers) = line.split_once(':')?;
        (name.trim() == interface).then_some(numbers)
    })?;
    let mut numbers = numbers.split_whitespace().map(str::parse::<u64>);
    let mut next = |skipped: usize| numbers.nth(skipped)?.ok();
    let [received_bytes, received] = [next(0)?, next(0)?];
    let [sent_bytes, sent] = [next(6)?, next(0)?];
    Some(Traffic {
        packets: received + sent,
        bytes: received_bytes + sent_bytes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_directions_of_the_interface() {
        let table = "Inter-|   Receive                |  Transmit\n \
                     face |bytes    packets errs\n    \
                     lo: 1 2 0 0 0 0 0 0 1 2 0 0 0 0 0 0\n  \
                     eth0: 1000 10 0 0 0 0 0 3 200 4 0 0 0 0 0 0\n";
        let expected = Traffic {
            packets: 14,
            bytes: 1200,
        };
        assert_eq!(parse(table, "eth0"), Some(expected));
        assert_eq!(parse(table, "eth1"), None);
    }
}
