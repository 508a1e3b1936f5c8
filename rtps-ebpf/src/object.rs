//! The built programs, embedded: whoever loads them needs no BPF tool chain.

/// ELF headers are read in place, so they need their natural alignment.
#[repr(C, align(64))]
struct Aligned<T: ?Sized>(T);

static EMBEDDED: &Aligned<[u8]> = &Aligned(*include_bytes!("../rtps-ebpf.o"));

/// The object that `cargo xtask build-ebpf` built from `src/bin/rtps`; feature `object`.
pub static OBJECT: &[u8] = &EMBEDDED.0;
