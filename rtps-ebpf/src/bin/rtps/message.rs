//! One RTPS message at one of the hooks: whom does it concern?

use core::ops::ControlFlow;

use rtps_ebpf::{
    Counter, Reason, Step, Walk,
    abi::Domain,
    walk::{Concerned, MAX_STEPS},
};

use crate::{
    maps::Scratch,
    sys::{Message, Packet, Repeat, repeat},
};

/// Walks a message, renews the participant that sent it, and says whether it concerns built-in
/// endpoints; the scratch space then has the apps. If it concerns nobody, comes back with the counter
/// to drop it under.
///
/// Like the other large steps it is a function of its own, so that not all of them together need
/// room on the stack.
#[inline(never)]
pub(crate) fn examine<P: Packet>(
    message: &Message<P>,
    scratch: &mut Scratch,
    domain: &Domain,
) -> Result<bool, Counter> {
    begin(scratch, domain);
    walk(message, scratch);
    conclude(scratch)
}

/// Prepares for the walk over the first message of those that came together.
#[inline(always)]
pub(crate) fn begin(scratch: &mut Scratch, domain: &Domain) {
    scratch.walk = Walk::new(domain.guid_prefix);
}

/// Walks one of the messages.
#[inline(always)]
pub(crate) fn walk<P: Packet>(message: &Message<P>, scratch: &mut Scratch) {
    // Assumes the worst until a turn knows better.
    scratch.malformed = Some(Reason::TooManySubmessages);
    repeat(MAX_STEPS, &mut Walking { scratch, message });
}

/// Does with the messages together what [`examine`] does with one.
#[inline(always)]
pub(crate) fn conclude(scratch: &mut Scratch) -> Result<bool, Counter> {
    let findings = scratch.walk.findings(scratch.malformed);
    if findings.malformed.is_none() && !findings.foreign_source {
        scratch.lookup.heard(scratch.walk.sender());
    }
    let Concerned { targets, built_in } = findings.concerned()?;
    scratch.targets = targets;
    Ok(built_in)
}

struct Walking<'a, P> {
    scratch: &'a mut Scratch,
    message: &'a Message<P>,
}

impl<P: Packet> Repeat for Walking<'_, P> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let scratch = &mut *self.scratch;
        match scratch.walk.step(self.message, &scratch.lookup) {
            Step::Continue => return ControlFlow::Continue(()),
            Step::Done => scratch.malformed = None,
            Step::Malformed(reason) => scratch.malformed = Some(reason),
        }
        ControlFlow::Break(())
    }
}
