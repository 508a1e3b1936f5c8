//! Which layers a scenario runs on: each becomes a module of that name, with a test for each layer.
//!
//! Where discovery matters, the kernel layer is tested with discovery in the kernel and with discovery left to rtpsd.

/// Makes two tests of each scenario: `NAME::kernel` and `NAME::in_process`.
macro_rules! on_both_layers {
    ($($scenario:ident),+ $(,)?) => {
        $(crate::layers::tests! {
            $scenario: kernel(Kernel), in_process(InProcess)
        })+
    };
}
pub(crate) use on_both_layers;

/// Makes three tests of each scenario: `NAME::kernel`, `NAME::user_discovery` and `NAME::in_process`.
macro_rules! on_every_layer {
    ($($scenario:ident),+ $(,)?) => {
        $(crate::layers::tests! {
            $scenario: kernel(Kernel), user_discovery(UserDiscovery), in_process(InProcess)
        })+
    };
}
pub(crate) use on_every_layer;

/// Makes a test of each scenario for each pair of layers that two hosts may have.
macro_rules! on_pairs_of_layers {
    ($($scenario:ident),+ $(,)?) => {
        $(crate::layers::tests! {
            $scenario:
            kernel_to_kernel(Kernel, Kernel),
            in_process_to_in_process(InProcess, InProcess),
            kernel_to_in_process(Kernel, InProcess),
            in_process_to_kernel(InProcess, Kernel)
        })+
    };
}
pub(crate) use on_pairs_of_layers;

/// The module of a scenario.
macro_rules! tests {
    ($scenario:ident: $($name:ident($($layer:ident),+)),+) => {
        mod $scenario {
            $(
                #[test]
                fn $name() -> anyhow::Result<()> {
                    rtps_tests::skip_unless!(rtps_tests::require::root());
                    super::$scenario($(rtps_tests::layer::Layer::$layer),+)
                }
            )+
        }
    };
}
pub(crate) use tests;
