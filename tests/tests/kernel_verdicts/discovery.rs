//! What the kernel does for the built-in endpoints: it remembers, answers, and tells rtpsd the news.

use std::net::SocketAddr;

use anyhow::{Context as _, Result};
use rtps_ebpf::{
    abi::{HOOK_FILTER, HOOK_INGRESS, RECORD_ANSWERED},
    frame::mapped,
};
use rtps_tests::{
    packet::{ANYBODY, BUILTIN_TOPICS, Message, at_socket, number, submessages},
    require, skip_unless,
};

use crate::{
    layer::{METATRAFFIC_PORT, MULTICAST_PORT, OWN, REMOTE},
    stage::{GROUP, REMOTE_V4, REPLY_PORT, Stage, announcement, own_announcement, receive},
    valid::counts,
};

const PUBLICATIONS: usize = 0;
const ACKNACK: u8 = 0x06;
const HEARTBEAT: u8 = 0x07;
const GAP: u8 = 0x08;
const INFO_TS: u8 = 0x09;
const INFO_DST: u8 = 0x0e;
const DATA: u8 = 0x15;

fn to_us() -> Message {
    Message::from(REMOTE).destination(OWN)
}

fn sample(sequence: i64) -> Message {
    to_us().sample(BUILTIN_TOPICS[PUBLICATIONS].1, sequence, &[0, 3, 0, 0])
}

fn heartbeat(first: i64, last: i64) -> Message {
    let (reader, writer) = BUILTIN_TOPICS[PUBLICATIONS];
    to_us().heartbeat(reader, writer, first, last)
}

/// submessageIds in their order.
fn ids(datagram: &[u8]) -> Vec<u8> {
    submessages(datagram).iter().map(|(id, _)| *id).collect()
}

/// The sequence numbers of the DATA in a datagram.
fn samples(datagram: &[u8]) -> Vec<u32> {
    submessages(datagram)
        .into_iter()
        .filter(|(id, _)| *id == DATA)
        .map(|(_, body)| u32::from_le_bytes(body[16..20].try_into().unwrap()))
        .collect()
}

#[test]
fn an_unknown_participant_is_answered_and_told() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let socket = stage.socket(REMOTE_V4)?;
    let message = announcement(REMOTE, b"one!");
    let heard = stage.tell(&socket, &message)?;

    let [(from, answer)] = &heard.answers[..] else {
        panic!("one datagram: {heard:?}");
    };
    assert_eq!(from.port(), METATRAFFIC_PORT);
    assert_eq!(answer[8..20], OWN);
    assert_eq!(
        ids(answer),
        [INFO_DST, INFO_TS, DATA, HEARTBEAT, HEARTBEAT, HEARTBEAT]
    );
    let own = own_announcement();
    assert_eq!(answer[36..][..own.bytes().len() - 20], own.bytes()[20..]);
    let expected = counts(&[
        ("ingress_messages", 1),
        ("strangers", 1),
        ("discovery_news", 1),
        ("answers", 1),
        ("answer_bytes", answer.len() as u64),
    ]);
    assert_eq!(heard.counts, expected);

    let [record] = &heard.news[..] else {
        panic!("one record: {heard:?}");
    };
    assert_eq!(record.message, message.bytes());
    assert_eq!(record.header.hook, HOOK_INGRESS);
    assert_eq!(record.header.flags, RECORD_ANSWERED);
    assert_eq!(record.header.source_port, REPLY_PORT);
    let stranger = stage.stranger(REMOTE)?.context("not remembered")?;
    assert_eq!(stranger.reply_port, u32::from(REPLY_PORT));
    assert_eq!(stranger.addresses[0], mapped(REMOTE_V4.octets()));
    assert_eq!(stranger.last_seen_ns, record.header.received_ns);
    Ok(())
}

#[test]
fn what_is_known_is_swallowed_and_what_has_changed_is_told_once() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    stage.know_remote()?;
    let socket = stage.socket(REMOTE_V4)?;
    for (more, news) in [(b"one!", 1), (b"one!", 0), (b"two!", 1), (b"two!", 0)] {
        let before = stage.peer()?.last_seen_ns;
        let heard = stage.tell(&socket, &announcement(REMOTE, more))?;
        assert_eq!(heard.news.len(), news, "{heard:?}");
        assert!(heard.answers.is_empty(), "it knows us already");
        assert!(stage.peer()?.last_seen_ns > before);
    }
    Ok(())
}

#[test]
fn multicast_goes_on_to_other_stacks_but_not_to_rtpsd() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let socket = stage.socket(REMOTE_V4)?;
    let (other, rtpsd) = (stage.member()?, stage.member()?);
    stage.layer.attach_filter(&rtpsd)?;
    let message = announcement(REMOTE, &[3; 400]);
    let heard = stage.tell_at(
        &socket,
        SocketAddr::new(GROUP.into(), MULTICAST_PORT),
        &message,
    )?;

    assert_eq!(heard.answers.len(), 1);
    assert_eq!(heard.news.len(), 1);
    assert_eq!(heard.counts["drop_handled"], 1);
    let [(from, copy)] = &receive(&other)?[..] else {
        panic!("the other stack gets it once");
    };
    assert_eq!(copy, message.bytes());
    assert_eq!(from.port(), REPLY_PORT);
    assert!(receive(&rtpsd)?.is_empty());
    Ok(())
}

#[test]
fn without_rtpsd_nothing_is_answered() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    stage.set_life_of_rtpsd(1)?;
    let socket = stage.socket(REMOTE_V4)?;
    let heard = stage.tell(&socket, &announcement(REMOTE, b"one!"))?;
    assert!(heard.answers.is_empty());
    assert_eq!(heard.news[0].header.flags, 0, "it is left to rtpsd");

    stage.know_remote()?;
    let heard = stage.tell(&socket, &heartbeat(1, 3))?;
    assert!(heard.answers.is_empty());
    assert_eq!(heard.news[0].header.flags, 0);
    Ok(())
}

#[test]
fn samples_are_taken_in_order_and_acknowledged() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    stage.know_remote()?;
    let socket = stage.socket(REMOTE_V4)?;
    // Number, and whether rtpsd is told.
    for (sequence, news) in [(1, 1), (1, 0), (3, 0), (2, 1), (3, 1)] {
        let heard = stage.tell(&socket, &sample(sequence))?;
        assert_eq!(heard.news.len(), news, "{sequence}");
        assert!(heard.answers.is_empty());
    }
    let heard = stage.tell(&socket, &heartbeat(1, 5))?;
    assert!(heard.news.is_empty());
    let answer = &heard.answers.first().context("no answer")?.1;
    let submessages = submessages(answer);
    let (_, acknack) = submessages.last().context("empty")?;
    assert_eq!(ids(answer), [INFO_DST, ACKNACK]);
    assert_eq!(acknack[8..16], number(4));
    assert_eq!(acknack[16..20], [2, 0, 0, 0], "4 and 5 are missing");
    Ok(())
}

#[test]
fn what_rtpsd_could_not_be_given_is_not_acknowledged() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    stage.know_remote()?;
    let socket = stage.socket(REMOTE_V4)?;
    stage.tell(&socket, &sample(1))?;
    fill_news(&mut stage)?;

    stage.reset_counters()?;
    socket.send_to(sample(2).bytes(), (stage.veth.a.v4, METATRAFFIC_PORT))?;
    socket.send_to(heartbeat(1, 2).bytes(), (stage.veth.a.v4, METATRAFFIC_PORT))?;
    let heard = stage.hear(&socket)?;
    assert_eq!(heard.counts["lost_news_full"], 1);
    assert_eq!(stage.peer()?.writers[PUBLICATIONS].next, 2);
    let answer = &heard.answers.first().context("no answer")?.1;
    assert_eq!(submessages(answer)[1].1[8..16], number(2));

    assert_eq!(stage.tell(&socket, &sample(2))?.news.len(), 1);
    assert_eq!(stage.peer()?.writers[PUBLICATIONS].next, 3);
    Ok(())
}

/// Lets the remote change its announcement until rtpsd's ring has no room for it.
fn fill_news(stage: &mut Stage) -> Result<()> {
    stage.layer.know_peer(*b"chatterbox--")?;
    for change in 0_u32..2_000 {
        let message = announcement(
            *b"chatterbox--",
            &[&change.to_le_bytes()[..], &[0; 2_400]].concat(),
        );
        stage
            .layer
            .run_filter_undrained(&at_socket(METATRAFFIC_PORT, message.bytes()))?;
    }
    anyhow::ensure!(stage.layer.counts()?.contains_key("lost_news_full"));
    // Nor for a small record.
    for sequence in 1..100 {
        let message = Message::from(*b"chatterbox--").destination(OWN).sample(
            BUILTIN_TOPICS[PUBLICATIONS].1,
            sequence,
            &[0, 3, 0, 0],
        );
        stage
            .layer
            .run_filter_undrained(&at_socket(METATRAFFIC_PORT, message.bytes()))?;
    }
    Ok(())
}

#[test]
fn requests_are_answered_with_samples_gaps_and_a_heartbeat() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    stage.know_remote()?;
    let socket = stage.socket(REMOTE_V4)?;
    // 3 and 4 are gone.
    for sequence in [1, 2, 5, 6, 7, 8] {
        stage.store(PUBLICATIONS as u32, sequence, 600)?;
    }
    stage.publish(PUBLICATIONS as u32, 1, 8)?;
    let message = to_us().request(BUILTIN_TOPICS[PUBLICATIONS], 1, 8);
    let heard = stage.tell(&socket, &message)?;

    assert!(heard.news.is_empty());
    let answers: Vec<&[u8]> = heard.answers.iter().map(|(_, bytes)| &bytes[..]).collect();
    assert_eq!(answers.len(), 3, "two samples fit a datagram");
    assert_eq!(ids(answers[0])[..3], [INFO_DST, GAP, INFO_TS]);
    assert_eq!(
        answers
            .iter()
            .copied()
            .flat_map(samples)
            .collect::<Vec<_>>(),
        [1, 2, 5, 6, 7, 8]
    );
    assert_eq!(ids(answers[2]).last(), Some(&HEARTBEAT));
    assert_eq!(stage.peer()?.readers[PUBLICATIONS].acknowledged, 1);

    let heard = stage.tell(
        &socket,
        &to_us().request(BUILTIN_TOPICS[PUBLICATIONS], 9, 0),
    )?;
    assert!(heard.news.is_empty());
    assert_eq!(stage.peer()?.readers[PUBLICATIONS].acknowledged, 9);
    Ok(())
}

#[test]
fn the_filter_tells_and_leaves_answers_to_rtpsd() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    const NOTHING: [u8; 0] = [];
    let mut told = |message: &Message| -> Result<Vec<u8>> {
        let outcome = stage
            .layer
            .run_filter(&at_socket(METATRAFFIC_PORT, message.bytes()))?;
        assert_eq!(outcome.verdict, 0, "the socket gets nothing");
        assert!(
            outcome
                .news
                .iter()
                .all(|news| news.header.hook == HOOK_FILTER)
        );
        Ok(outcome.news.iter().map(|news| news.header.flags).collect())
    };
    assert_eq!(told(&announcement(REMOTE, b"one!"))?, [0]);
    assert_eq!(told(&announcement(REMOTE, b"one!"))?, NOTHING);
    assert_eq!(told(&announcement(OWN, b"one!"))?, NOTHING, "our own voice");
    assert_eq!(told(&sample(1))?, [0], "its writers are to be greeted");
    assert_eq!(
        told(&sample(2))?,
        [RECORD_ANSWERED],
        "there is nothing to answer"
    );
    assert_eq!(told(&heartbeat(1, 3))?, [0]);
    let unknown = Message::from(*b"nobody------").data(ANYBODY, BUILTIN_TOPICS[0].1, 8);
    assert_eq!(told(&unknown)?, NOTHING);
    Ok(())
}
