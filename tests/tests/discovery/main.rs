//! Discovery in the kernel: what it answers, keeps and tells without rtpsd, and what it does not let anybody do to it.
//!
//! `remote` is a participant that exists only as far as discovery goes, `crowd` many of them behind one socket,
//! `support` asks rtpsd what it knows and stops it; the rest is one theme a file. Where a test is about the kernel
//! alone, rtpsd stands still (SIGSTOP) meanwhile: then nobody else can have answered.

mod addresses;
mod answers;
mod binding;
mod crowd;
mod flood;
mod news_full;
mod other_stacks;
mod quiet;
mod remote;
mod steady;
mod stopped;
mod support;
mod wire;
