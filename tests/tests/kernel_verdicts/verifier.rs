//! What the programs cost the kernel's verifier.

use anyhow::Result;
use rtps_ebpf::abi::DOORBELL_PACKET;
use rtps_tests::{require, skip_unless};

use crate::layer::Layer;

#[test]
fn programs_stay_far_below_the_verifiers_limit() -> Result<()> {
    skip_unless!(require::root());
    // The limit is 1,000,000; what grows past this bound has begun to explode.
    const BOUND: u32 = 200_000;
    let mut layer = Layer::new(DOORBELL_PACKET)?;
    for instructions in layer.verified_instructions()?.into_iter().flatten() {
        assert!(instructions < BOUND, "{instructions} instructions");
    }
    Ok(())
}
