//! One RTPS message at one of the hooks: whom does it concern?

use core::ops::ControlFlow;

use rtps_ebpf::{
    Reason, Step, Walk,
    entity::GuidPrefix,
    walk::{Findings, MAX_STEPS},
};

use crate::{
    maps::{self, RouteMap, Scratch},
    sys::{Packet, Repeat, repeat},
};

/// Walks the message, and renews the participant that sent it.
#[inline(always)]
pub(crate) fn examine<M: Packet>(
    message: &M,
    own: &GuidPrefix,
    now_ns: u64,
    scratch: &mut Scratch,
) -> Findings {
    scratch.walk = Walk::new(*own);
    // Assumes the worst until a turn knows better.
    scratch.malformed = Some(Reason::TooManySubmessages);
    repeat(
        MAX_STEPS,
        &mut Walking {
            scratch: &mut *scratch,
            message,
        },
    );
    if scratch.malformed.is_none() {
        maps::renew_peer(scratch.walk.sender(), now_ns);
    }
    scratch.walk.findings(scratch.malformed)
}

struct Walking<'a, M> {
    scratch: &'a mut Scratch,
    message: &'a M,
}

impl<M: Packet> Repeat for Walking<'_, M> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let scratch = &mut *self.scratch;
        match scratch.walk.step(self.message, &RouteMap) {
            Step::Continue => return ControlFlow::Continue(()),
            Step::Done => scratch.malformed = None,
            Step::Malformed(reason) => scratch.malformed = Some(reason),
        }
        ControlFlow::Break(())
    }
}
