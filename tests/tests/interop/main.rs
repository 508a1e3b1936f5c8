//! Our apps against unmodified Cyclone DDS and Fast DDS, and against each other, over real links.
//!
//! A scenario runs once with the kernel layer under our apps and once with the in-process layer; the apps are
//! unprivileged both times. Scenarios wait for what they are about and never for time to pass: a busy machine makes
//! them slow, not red. Where a test must not depend on which side sees a match first, it uses TRANSIENT_LOCAL.

mod best_effort;
mod coexistence;
mod durability;
mod flow;
mod instances;
mod large;
mod loss;
mod matching;
mod reliable;
mod soak;
mod stage;
mod wire;

/// Makes two tests of each scenario: `kernel::NAME` and `in_process::NAME`.
macro_rules! on_both_layers {
    ($($scenario:ident),+ $(,)?) => {
        mod kernel {
            $(
                #[test]
                fn $scenario() -> anyhow::Result<()> {
                    rtps_tests::skip_unless!(rtps_tests::require::root());
                    super::$scenario(crate::stage::Layer::Kernel)
                }
            )+
        }
        mod in_process {
            $(
                #[test]
                fn $scenario() -> anyhow::Result<()> {
                    rtps_tests::skip_unless!(rtps_tests::require::root());
                    super::$scenario(crate::stage::Layer::InProcess)
                }
            )+
        }
    };
}
pub(crate) use on_both_layers;
