// Round trips and streams of samples on eProsima Fast DDS 2.9, measured as `rtps perf` measures its own: the same roles,
// the same options as far as the benchmarks use them, the same JSON lines.
#include "peer.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using eprosima::fastrtps::types::ReturnCode_t;

namespace {

// Above this a sample does not fit one UDP datagram and Fast DDS wants its asynchronous writer.
constexpr uint32_t SYNCHRONOUS_MAX = 60000;
constexpr uint32_t ENCAPSULATION_SIZE = 4;
constexpr uint32_t NUMBER_SIZE = 8;
// A history holds no more bytes of samples than the socket of a reader, but some samples.
constexpr uint32_t HISTORY_BYTES = 2 << 20;
constexpr uint32_t SOCKET_BUFFER = 4 << 20;

struct Options {
    std::string role;
    uint32_t size = 100;
    uint32_t readers = 1; // a writer waits for so many
    double rate = 0;      // bursts a second; 0: as fast as possible
    uint32_t burst = 1;
    double warm_up_s = 0;
    std::string interface;
};

Options options;

double now()
{
    using namespace std::chrono;
    return duration<double>(steady_clock::now().time_since_epoch()).count();
}

template <typename T> T* checked(const char* call, T* made)
{
    if (made == nullptr) {
        std::fprintf(stderr, "%s failed\n", call);
        std::exit(1);
    }
    return made;
}

// Octets that begin with the sample's number.
struct Sample {
    std::vector<uint8_t> bytes = std::vector<uint8_t>(options.size);

    uint64_t number() const
    {
        uint64_t number;
        std::memcpy(&number, bytes.data(), NUMBER_SIZE);
        return number;
    }

    void set_number(uint64_t number)
    {
        std::memcpy(bytes.data(), &number, NUMBER_SIZE);
    }
};

// An array of octets, the cheapest there is to serialize.
class SampleSupport : public TopicDataType {
public:
    SampleSupport()
    {
        setName("Sample");
        m_typeSize = ENCAPSULATION_SIZE + options.size;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }

    bool serialize(void* data, SerializedPayload_t* payload) override
    {
        const auto& bytes = static_cast<Sample*>(data)->bytes;
        if (ENCAPSULATION_SIZE + bytes.size() > payload->max_size)
            return false;
        const uint8_t little_endian[ENCAPSULATION_SIZE] = {0, 1, 0, 0};
        payload->encapsulation = CDR_LE;
        std::memcpy(payload->data, little_endian, ENCAPSULATION_SIZE);
        std::memcpy(payload->data + ENCAPSULATION_SIZE, bytes.data(), bytes.size());
        payload->length = ENCAPSULATION_SIZE + static_cast<uint32_t>(bytes.size());
        return true;
    }

    bool deserialize(SerializedPayload_t* payload, void* data) override
    {
        if (payload->length < ENCAPSULATION_SIZE + NUMBER_SIZE)
            return false;
        static_cast<Sample*>(data)->bytes.assign(payload->data + ENCAPSULATION_SIZE,
                                                 payload->data + payload->length);
        return true;
    }

    std::function<uint32_t()> getSerializedSizeProvider(void*) override
    {
        return [] { return ENCAPSULATION_SIZE + options.size; };
    }

    void* createData() override
    {
        return new Sample();
    }

    void deleteData(void* data) override
    {
        delete static_cast<Sample*>(data);
    }

    bool getKey(void*, InstanceHandle_t*, bool) override
    {
        return false;
    }
};

DomainParticipantQos participant_qos()
{
    DomainParticipantQos qos;
    // UDP only: by default two processes of one host would talk through shared memory.
    auto udp = std::make_shared<UDPv4TransportDescriptor>();
    if (!options.interface.empty())
        udp->interfaceWhiteList.emplace_back(options.interface);
    // The system's default holds some hundred small samples, which a fast writer overruns again and again.
    udp->sendBufferSize = SOCKET_BUFFER;
    udp->receiveBufferSize = SOCKET_BUFFER;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    return qos;
}

// The policies that writers and readers have in common.
template <typename Qos> Qos endpoint_qos(Qos qos)
{
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.reliability().max_blocking_time = Duration_t(0.1L);
    qos.durability().kind = VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_ALL_HISTORY_QOS;
    const auto samples =
        static_cast<int32_t>(std::clamp<uint32_t>(HISTORY_BYTES / options.size, 4, 5000));
    qos.resource_limits().max_samples = samples;
    qos.resource_limits().allocated_samples = std::min(samples, 100);
    qos.resource_limits().max_instances = 1;
    qos.resource_limits().max_samples_per_instance = samples;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return qos;
}

// The endpoints of one program: what it writes, and what it reads.
struct Endpoints {
    DomainParticipant* participant;
    DataWriter* writer = nullptr;
    DataReader* reader = nullptr;

    Endpoints()
    {
        auto factory = DomainParticipantFactory::get_instance();
        participant =
            checked("create_participant", factory->create_participant(0, participant_qos()));
        TypeSupport type(new SampleSupport());
        type.register_type(participant);
    }

    ~Endpoints()
    {
        if (reader != nullptr)
            reader->set_listener(nullptr);
        participant->delete_contained_entities();
        DomainParticipantFactory::get_instance()->delete_participant(participant);
    }

    void write_to(const char* name, DataWriterListener* listener)
    {
        auto publisher =
            checked("create_publisher", participant->create_publisher(PUBLISHER_QOS_DEFAULT));
        DataWriterQos qos = endpoint_qos(DataWriterQos());
        // By default 3 s, which would be the time until a lost sample is missed.
        qos.reliable_writer_qos().times.heartbeatPeriod = Duration_t(0.01L);
        if (options.size > SYNCHRONOUS_MAX)
            qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
        writer = checked("create_datawriter",
                         publisher->create_datawriter(topic(name), qos, listener));
    }

    void read_from(const char* name, DataReaderListener* listener)
    {
        auto subscriber =
            checked("create_subscriber", participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT));
        reader = checked("create_datareader",
                         subscriber->create_datareader(topic(name), endpoint_qos(DataReaderQos()),
                                                       listener));
    }

private:
    Topic* topic(const char* name)
    {
        return checked("create_topic",
                       participant->create_topic(name, "Sample", TOPIC_QOS_DEFAULT));
    }
};

void wait_until_stopped()
{
    while (!peer_stopped())
        peer_sleep_us(5000);
}

void print_ready()
{
    std::puts("{\"event\":\"ready\"}");
    std::fflush(stdout);
}

class MatchedReaders : public DataWriterListener {
public:
    void on_publication_matched(DataWriter*, const PublicationMatchedStatus& status) override
    {
        count = status.current_count;
    }

    std::atomic<int32_t> count{0};
};

class Pong : public DataReaderListener {
public:
    void on_data_available(DataReader* reader) override
    {
        SampleInfo info;
        while (reader->take_next_sample(&sample_, &info) == ReturnCode_t::RETCODE_OK) {
            if (info.valid_data)
                writer->write(&sample_);
        }
    }

    DataWriter* writer = nullptr;

private:
    Sample sample_;
};

// The next ping leaves from the callback that got the answer to the last.
class Ping : public DataReaderListener {
public:
    void on_data_available(DataReader* reader) override
    {
        SampleInfo info;
        while (reader->take_next_sample(&answer_, &info) == ReturnCode_t::RETCODE_OK) {
            std::lock_guard<std::mutex> guard(lock_);
            if (!info.valid_data || answer_.number() != number_)
                continue;
            const double arrived = now();
            if (began_ == 0) {
                print_ready();
                began_ = arrived + options.warm_up_s;
            }
            if (sent_at_ >= began_)
                times_.push_back(arrived - sent_at_);
            send(arrived);
        }
    }

    // A ping that was lost, or sent before the other end was there, is followed by another.
    void poke()
    {
        std::lock_guard<std::mutex> guard(lock_);
        if (now() - sent_at_ > 0.05) {
            lost_ += began_ == 0 ? 0 : 1;
            send(now());
        }
    }

    void print_summary()
    {
        std::lock_guard<std::mutex> guard(lock_);
        std::sort(times_.begin(), times_.end());
        std::printf("{\"event\":\"summary\",\"role\":\"ping\",\"count\":%zu,\"lost\":%llu,"
                    "\"seconds\":%f,\"p50_us\":%f,\"p90_us\":%f,\"p99_us\":%f,\"p999_us\":%f,"
                    "\"max_us\":%f}\n",
                    times_.size(), static_cast<unsigned long long>(lost_), now() - began_,
                    percentile(0.5), percentile(0.9), percentile(0.99), percentile(0.999),
                    percentile(1.0));
    }

    DataWriter* writer = nullptr;

private:
    void send(double time)
    {
        number_++;
        sent_at_ = time;
        sample_.set_number(number_);
        writer->write(&sample_);
    }

    double percentile(double share) const
    {
        if (times_.empty())
            return 0;
        const auto last = times_.size() - 1;
        return times_[std::min(last, static_cast<size_t>(share * times_.size()))] * 1e6;
    }

    std::mutex lock_;
    Sample sample_;
    Sample answer_;
    uint64_t number_ = 0;
    uint64_t lost_ = 0;
    double sent_at_ = 0;
    double began_ = 0; // the end of the warm-up; 0: no answer yet
    std::vector<double> times_;
};

class Counter : public DataReaderListener {
public:
    void on_data_available(DataReader* reader) override
    {
        SampleInfo info;
        while (reader->take_next_sample(&sample_, &info) == ReturnCode_t::RETCODE_OK) {
            if (info.valid_data)
                add(now());
        }
    }

    void print_summary() const
    {
        const double seconds = last_ - first_;
        const double rate = seconds > 0 ? static_cast<double>(count_) / seconds : 0;
        std::printf("{\"event\":\"summary\",\"role\":\"sub\",\"count\":%llu,\"lost\":%llu,"
                    "\"seconds\":%f,\"samples_per_s\":%f,\"bytes_per_s\":%f}\n",
                    static_cast<unsigned long long>(count_),
                    static_cast<unsigned long long>(lost_), seconds, rate, rate * options.size);
    }

private:
    void add(double arrived)
    {
        if (began_ == 0) {
            print_ready();
            began_ = arrived + options.warm_up_s;
        } else if (sample_.number() > expected_) {
            lost_ += sample_.number() - expected_;
        }
        expected_ = sample_.number() + 1;
        if (arrived < began_)
            return;
        if (count_++ == 0)
            first_ = arrived;
        last_ = arrived;
    }

    Sample sample_;
    uint64_t expected_ = 0;
    uint64_t count_ = 0;
    uint64_t lost_ = 0;
    double began_ = 0;
    double first_ = 0;
    double last_ = 0;
};

void run_ping()
{
    Endpoints endpoints;
    Ping ping;
    endpoints.write_to("Ping", nullptr);
    ping.writer = endpoints.writer;
    endpoints.read_from("Pong", &ping);
    while (!peer_stopped()) {
        peer_sleep_us(5000);
        ping.poke();
    }
    endpoints.reader->set_listener(nullptr);
    ping.print_summary();
}

void run_pong()
{
    Endpoints endpoints;
    Pong pong;
    endpoints.write_to("Pong", nullptr);
    pong.writer = endpoints.writer;
    endpoints.read_from("Ping", &pong);
    wait_until_stopped();
    endpoints.reader->set_listener(nullptr);
}

void run_publisher()
{
    Endpoints endpoints;
    MatchedReaders readers;
    endpoints.write_to("Data", &readers);
    while (!peer_stopped() && readers.count < static_cast<int32_t>(options.readers))
        peer_sleep_us(1000);
    print_ready();
    Sample sample;
    const double start = now();
    uint64_t sent = 0;
    for (double bursts = 1; !peer_stopped(); bursts++) {
        for (uint32_t i = 0; i < options.burst && !peer_stopped(); i++) {
            sample.set_number(sent);
            // False after the time that a full history may block.
            sent += endpoints.writer->write(&sample) ? 1 : 0;
        }
        if (options.rate > 0) {
            const double due = start + bursts / options.rate;
            std::this_thread::sleep_for(std::chrono::duration<double>(due - now()));
        }
    }
    endpoints.writer->set_listener(nullptr);
    std::printf("{\"event\":\"summary\",\"role\":\"pub\",\"count\":%llu}\n",
                static_cast<unsigned long long>(sent));
}

void run_subscriber()
{
    Endpoints endpoints;
    Counter counter;
    endpoints.read_from("Data", &counter);
    wait_until_stopped();
    endpoints.reader->set_listener(nullptr);
    counter.print_summary();
}

[[noreturn]] void usage(const char* program)
{
    std::fprintf(stderr,
                 "usage: %s ping|pong|pub|sub [--size BYTES] [--rate BURSTS] [--burst SAMPLES]\n"
                 "       [--peers READERS] [--warm-up SECONDS] [--interface ADDRESS]\n",
                 program);
    std::exit(2);
}

void parse(int argc, char** argv)
{
    if (argc < 2 || argc % 2 != 0)
        usage(argv[0]);
    options.role = argv[1];
    for (int i = 2; i < argc; i += 2) {
        const std::string name = argv[i];
        const char* value = argv[i + 1];
        if (name == "--size")
            options.size = std::max<uint32_t>(std::strtoul(value, nullptr, 10), NUMBER_SIZE);
        else if (name == "--rate")
            options.rate = std::strtod(value, nullptr);
        else if (name == "--burst")
            options.burst = static_cast<uint32_t>(std::strtoul(value, nullptr, 10));
        else if (name == "--peers")
            options.readers = static_cast<uint32_t>(std::strtoul(value, nullptr, 10));
        else if (name == "--warm-up")
            options.warm_up_s = std::strtod(value, nullptr);
        else if (name == "--interface")
            options.interface = value;
        else
            usage(argv[0]);
    }
}

} // namespace

int main(int argc, char** argv)
{
    parse(argc, argv);
    peer_catch_signals();
    if (options.role == "ping")
        run_ping();
    else if (options.role == "pong")
        run_pong();
    else if (options.role == "pub")
        run_publisher();
    else if (options.role == "sub")
        run_subscriber();
    else
        usage(argv[0]);
    return 0;
}
