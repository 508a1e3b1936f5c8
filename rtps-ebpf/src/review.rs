//! May an app say this? The walk over a datagram that the kernel is to send in an app's stead.
//!
//! On the wire all apps of a host are one participant, so the first byte of the entity ids alone tells who speaks.
//! Whether the submessages are good ones is for the receiver to judge; here counts in whose name they are.

use crate::{
    bytes::Bytes,
    entity::{GuidPrefix, is_built_in, slot},
    submessage::{Submessage, id},
    walk::{HEADER_LEN, MAGIC, MAJOR_VERSION},
};

/// Offset of writerId in the body of DATA and DATA_FRAG (RTPS 2.5, 9.4.5.4 and 9.4.5.5).
const WRITER_OF_DATA: u32 = 8;
/// The same in HEARTBEAT, HEARTBEAT_FRAG and GAP (9.4.5.6 to 9.4.5.8).
const WRITER_OF_OTHERS: u32 = 4;

/// What a step came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opinion {
    /// There may be more submessages.
    Continue,
    /// The datagram is at its end, and all of it in the app's own name.
    Granted,
    /// It is malformed, or in another's name.
    Denied,
}

/// Where the review of a datagram stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Review {
    own: GuidPrefix,
    slot: u8,
    offset: u32,
}

impl Review {
    /// At the beginning of a datagram of the app in `slot`. `own` is this host's GUID prefix in the domain.
    #[inline(always)]
    pub const fn new(own: GuidPrefix, slot: u8) -> Self {
        Self {
            own,
            slot,
            offset: 0,
        }
    }

    /// Takes the header, or one submessage.
    #[inline(always)]
    pub fn step(&mut self, datagram: &(impl Bytes + ?Sized)) -> Opinion {
        let granted = if self.offset == 0 {
            self.header(datagram)
        } else if self.offset < datagram.len() {
            self.submessage(datagram)
        } else {
            return Opinion::Granted;
        };
        match granted {
            Some(()) => Opinion::Continue,
            None => Opinion::Denied,
        }
    }

    /// RTPS 2.5, 8.3.5.
    #[inline(always)]
    fn header(&mut self, datagram: &(impl Bytes + ?Sized)) -> Option<()> {
        let header = datagram.load::<{ HEADER_LEN as usize }>(0)?;
        let [m0, m1, m2, m3, major, _minor, _, _, prefix @ ..] = header;
        let is_own = u32::from_be_bytes([m0, m1, m2, m3]) == MAGIC
            && major == MAJOR_VERSION
            && prefix == self.own;
        self.offset = HEADER_LEN;
        is_own.then_some(())
    }

    #[inline(always)]
    fn submessage(&mut self, datagram: &(impl Bytes + ?Sized)) -> Option<()> {
        let submessage = Submessage::read(datagram, self.offset).ok()?;
        self.offset = submessage.end();
        match submessage.id {
            id::DATA | id::DATA_FRAG => self.speaks(datagram, submessage.start + WRITER_OF_DATA),
            id::HEARTBEAT | id::HEARTBEAT_FRAG | id::GAP => {
                self.speaks(datagram, submessage.start + WRITER_OF_OTHERS)
            }
            // What readers say is for one writer. INFO_SRC would put other words into others' mouths.
            id::ACKNACK | id::NACK_FRAG | id::INFO_SRC => None,
            _ => Some(()),
        }
    }

    /// Whether the writer whose id is at `offset` is the app's.
    #[inline(always)]
    fn speaks(&self, datagram: &(impl Bytes + ?Sized), offset: u32) -> Option<()> {
        let writer = datagram.load::<4>(offset)?;
        (slot(writer) == self.slot && !is_built_in(writer)).then_some(())
    }
}

/// Reviews a whole datagram: exactly what the kernel does, for user space.
pub fn is_granted(datagram: &(impl Bytes + ?Sized), own: GuidPrefix, slot: u8) -> bool {
    let mut review = Review::new(own, slot);
    loop {
        match review.step(datagram) {
            Opinion::Continue => {}
            Opinion::Granted => return true,
            Opinion::Denied => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    const OWN: GuidPrefix = [7; 12];
    const SLOT: u8 = 3;
    const WRITER: [u8; 4] = [SLOT, 0, 1, 0x02];

    fn datagram(prefix: GuidPrefix, submessages: &[(u8, &[u8])]) -> Vec<u8> {
        let mut bytes = b"RTPS\x02\x05\x01\x99".to_vec();
        bytes.extend(prefix);
        for (id, body) in submessages {
            bytes.extend([*id, 0x01]);
            bytes.extend((body.len() as u16).to_be_bytes().iter().rev());
            bytes.extend(*body);
        }
        bytes
    }

    /// A body with the writer at an offset.
    fn body(offset: u32, writer: [u8; 4]) -> Vec<u8> {
        let mut body = std::vec![0; 28];
        body[offset as usize..][..4].copy_from_slice(&writer);
        body
    }

    fn granted(submessages: &[(u8, &[u8])]) -> bool {
        is_granted(datagram(OWN, submessages).as_slice(), OWN, SLOT)
    }

    #[test]
    fn an_app_speaks_for_its_own_writers() {
        for id in [id::DATA, id::DATA_FRAG] {
            assert!(granted(&[(id, &body(WRITER_OF_DATA, WRITER))]));
            assert!(!granted(&[(id, &body(WRITER_OF_OTHERS, WRITER))]));
        }
        for id in [id::HEARTBEAT, id::HEARTBEAT_FRAG, id::GAP] {
            assert!(granted(&[
                (id::INFO_TS, &[0; 8]),
                (id::INFO_DST, &[9; 12]),
                (id, &body(WRITER_OF_OTHERS, WRITER))
            ]));
        }
        assert!(granted(&[]));
    }

    #[test]
    fn and_for_nobody_else() {
        let own = body(WRITER_OF_DATA, WRITER);
        let others = body(WRITER_OF_DATA, [SLOT + 1, 0, 1, 0x02]);
        assert!(!granted(&[(id::DATA, &own), (id::DATA, &others)]));
        let built_in = body(WRITER_OF_DATA, [SLOT, 0, 3, 0xc2]);
        assert!(!granted(&[(id::DATA, &built_in)]));
        for id in [id::ACKNACK, id::NACK_FRAG, id::INFO_SRC] {
            assert!(!granted(&[(id, &body(WRITER_OF_OTHERS, WRITER))]));
        }
        let of_other_host = datagram([8; 12], &[(id::DATA, &own)]);
        assert!(!is_granted(of_other_host.as_slice(), OWN, SLOT));
    }

    #[test]
    fn what_is_cut_short_is_denied() {
        let whole = datagram(OWN, &[(id::DATA, &body(WRITER_OF_DATA, WRITER))]);
        assert!(is_granted(whole.as_slice(), OWN, SLOT));
        for len in (0..whole.len()).filter(|len| *len != HEADER_LEN as usize) {
            assert!(!is_granted(&whole[..len], OWN, SLOT), "{len} bytes");
        }
    }

    proptest! {
        #[test]
        fn it_ends_whatever_it_reads(rest: Vec<u8>) {
            let mut bytes = datagram(OWN, &[]);
            bytes.extend(rest);
            is_granted(bytes.as_slice(), OWN, SLOT);
        }
    }
}
