//! The exchange over one discovery message, behind both hooks: what is known is swallowed, what is new
//! goes to rtpsd, what asks for an answer gets one.
//!
//! Nothing counts before rtpsd has been given what it has to know, so that a sample which it could not
//! be given is never acknowledged.

use core::ops::ControlFlow;

use rtps_ebpf::{
    Counter,
    abi::{
        BUDGET_ALL, BUDGET_NEW, BUDGET_NEWS, BUDGET_STRANGERS, Domain, PEER_PROVEN,
        RECORD_ANSWERED, RecordHeader,
    },
    discovery::{Exchange, FILL_TURNS, MAX_DATAGRAMS, Setting, TURNS, budget},
};

use crate::{
    maps::{self, Counters, DomainWorld, Progress, Ring, Scratch},
    sys::{Message, Packet, Repeat, repeat},
};

/// What takes an answer to its destination.
pub(crate) trait Voice {
    /// Sends the exchange's answer.
    fn say(&mut self, exchange: &Exchange) -> Result<(), ()>;
}

/// A message that concerns built-in endpoints; `scratch` holds its walk and its record's header.
///
/// What is looked up is looked up where it is needed, and not before the message is gone through: the
/// verifier would follow that once for each thing that may or may not be there.
pub(crate) struct Conversation<'a, P> {
    pub(crate) message: &'a Message<P>,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) exchange: &'a mut Exchange,
    pub(crate) domain: &'static Domain,
}

impl<P: Packet> Conversation<'_, P> {
    /// Goes through the message, and tells rtpsd what it has to know; says whether there is something to
    /// answer. Fails when nothing of the message counts; else it is to be [`commit`](Self::commit)ted.
    #[inline(never)]
    pub(crate) fn listen(&mut self, may_answer: bool) -> Result<bool, ()> {
        self.begin(may_answer);
        let mut listening = Listening {
            exchange: &mut *self.exchange,
            message: self.message,
            world: DomainWorld::of(&self.scratch.header),
        };
        repeat(TURNS, &mut listening);
        self.settle()
    }

    /// Answers.
    #[inline(always)]
    pub(crate) fn speak<V: Voice>(&mut self, voice: &mut V) {
        let mut speaking = Speaking {
            exchange: &mut *self.exchange,
            header: &self.scratch.header,
            voice,
        };
        repeat(MAX_DATAGRAMS, &mut speaking);
    }

    /// Remembers the sender as it is now.
    #[inline(never)]
    pub(crate) fn commit(&self) {
        let sender = self.scratch.walk.sender();
        let Exchange { peer, .. } = &*self.exchange;
        if self.scratch.is_new {
            maps::remember(sender, peer);
        } else {
            maps::update(sender, peer, &self.scratch.progress);
        }
    }

    #[inline(never)]
    fn begin(&mut self, may_answer: bool) {
        let walk = &self.scratch.walk;
        let header = &self.scratch.header;
        let setting = Setting {
            now_ns: header.received_ns,
            age_ns: header.received_ns.saturating_sub(self.domain.count_base_ns),
            source: header.source_address,
            own: self.domain.guid_prefix,
            sender: *walk.sender(),
            domain_id: self.domain.domain_id,
            datagram_size: self.domain.datagram_size,
            end: walk.end(),
            may_answer,
            is_local: maps::is_own_address(&header.source_address),
        };
        let known = maps::known(walk.sender());
        if let Some(peer) = known {
            self.scratch.progress = Progress::of(peer);
        }
        self.exchange.begin(&setting, known);
    }

    #[inline(never)]
    fn settle(&mut self) -> Result<bool, ()> {
        let counters = Counters::of(self.scratch.header.ifindex);
        let outcome = self.exchange.outcome();
        if outcome.unknown {
            counters.count(Counter::DiscoveryUnknown);
            return Err(());
        }
        self.scratch.is_new = outcome.new;
        if outcome.new {
            self.admit(counters)?;
        }
        if outcome.news {
            self.allow_news(counters)?;
            self.report(outcome.answered, counters)?;
        } else {
            counters.count(Counter::DiscoveryQuiet);
        }
        Ok(outcome.speaks)
    }

    /// Takes a new participant in, unless too many come.
    #[inline(always)]
    fn admit(&self, counters: Counters) -> Result<(), ()> {
        let header = &self.scratch.header;
        let now_ns = header.received_ns;
        if maps::spend_of_source(&header.source_address, now_ns)
            && maps::spend(BUDGET_NEW, budget::NEW, now_ns, 1)
        {
            counters.count(Counter::Strangers);
            return Ok(());
        }
        counters.count(Counter::BudgetNew);
        Err(())
    }

    /// Whether rtpsd may be bothered: a stranger can always say something new.
    #[inline(always)]
    fn allow_news(&self, counters: Counters) -> Result<(), ()> {
        let now_ns = self.scratch.header.received_ns;
        if maps::is_peer(self.scratch.walk.sender())
            || maps::spend(BUDGET_NEWS, budget::NEWS, now_ns, 1)
        {
            return Ok(());
        }
        counters.count(Counter::BudgetNews);
        Err(())
    }

    /// Tells rtpsd what is new.
    #[inline(always)]
    fn report(&mut self, answered: bool, counters: Counters) -> Result<(), ()> {
        let header = &mut self.scratch.header;
        header.flags = if answered { RECORD_ANSWERED } else { 0 };
        let written = Ring::news().write(header, self.message);
        counters.count(match written {
            Ok(()) => Counter::DiscoveryNews,
            Err(()) => Counter::LostNewsFull,
        });
        written
    }
}

struct Listening<'a, P> {
    exchange: &'a mut Exchange,
    message: &'a Message<P>,
    world: DomainWorld,
}

impl<P: Packet> Repeat for Listening<'_, P> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        self.exchange.step(self.message, &self.world)
    }
}

struct Speaking<'a, V> {
    exchange: &'a mut Exchange,
    header: &'a RecordHeader,
    voice: &'a mut V,
}

impl<V: Voice> Repeat for Speaking<'_, V> {
    /// One datagram.
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        self.exchange.open();
        let mut filling = Filling {
            exchange: &mut *self.exchange,
            world: DomainWorld::of(self.header),
        };
        repeat(FILL_TURNS, &mut filling);
        if !self.exchange.has_datagram() {
            return ControlFlow::Break(());
        }
        let counters = Counters::of(self.header.ifindex);
        let len = u64::from(self.exchange.answer.len);
        if let Err(counter) = self.spend(len).and_then(|()| self.say()) {
            counters.count(counter);
            return ControlFlow::Break(());
        }
        counters.count(Counter::Answers);
        counters.add(Counter::AnswerBytes, len);
        if self.exchange.has_more() {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }
}

impl<V: Voice> Speaking<'_, V> {
    #[inline(always)]
    fn say(&mut self) -> Result<(), Counter> {
        self.voice
            .say(self.exchange)
            .map_err(|()| Counter::LostAnswers)
    }

    /// Pays for a datagram out of all budgets, or names the one that is spent.
    #[inline(never)]
    fn spend(&mut self, len: u64) -> Result<(), Counter> {
        let now_ns = self.exchange.setting.now_ns;
        let peer = &mut self.exchange.peer;
        let of_its_own = if peer.flags & PEER_PROVEN != 0 {
            budget::PEER
        } else {
            budget::UNPROVEN
        };
        peer.spent_until_ns = of_its_own
            .spend(peer.spent_until_ns, now_ns, len)
            .ok_or(Counter::BudgetPeer)?;
        let is_stranger = !maps::is_peer(&self.exchange.setting.sender);
        if is_stranger && !maps::spend(BUDGET_STRANGERS, budget::STRANGERS, now_ns, len) {
            return Err(Counter::BudgetStrangers);
        }
        if !maps::spend(BUDGET_ALL, budget::ALL, now_ns, len) {
            return Err(Counter::BudgetAll);
        }
        Ok(())
    }
}

struct Filling<'a> {
    exchange: &'a mut Exchange,
    world: DomainWorld,
}

impl Repeat for Filling<'_> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        self.exchange.fill(&self.world)
    }
}
