// Readers and writers of Fast DDS behind a pipe, with the names and settings of rmw_fastrtps: ./peer DOMAIN [udp]
//
// A frame is a length (4 bytes, little endian, of what follows it), a letter, the number of a reader or writer (4 bytes) and:
//   in   R, W  a new reader, a new writer: reliable, latched (1 byte each), depth (4), topic, type (each ends with a zero)
//        S     a sample: the identity of the sample that it answers (24 bytes, zeros: none), CDR
//   out  C     it is made: its GUID (16)
//        N     how many endpoints match it (4)
//        I     the identity of a sample that was written with an identity (24)
//        M     a sample: its identity (24), the identity of the sample that it answers (24), CDR
// At the end of the input the participant leaves. Where its parent is killed it is killed as well, even if it is stopped.
// Apart from `udp` it speaks over shared memory too. As with ROS_LOCALHOST_ONLY=1, all is on 127.0.0.1.
#include <sys/prctl.h>

#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
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
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/transport/shared_mem/SharedMemTransportDescriptor.h>

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using Bytes = std::vector<std::uint8_t>;

namespace {

// As many participants of a domain are looked for on a machine.
constexpr std::uint32_t MAX_PARTICIPANTS = 40;
constexpr std::size_t IDENTITY_BYTES = 24;

template <class T>
T *must(T *made, const char *what)
{
    if (made == nullptr) {
        throw std::runtime_error(what);
    }
    return made;
}

// A message as it is on the wire: nothing is known of its fields.
class Raw : public fast::TopicDataType {
public:
    explicit Raw(const std::string &name)
    {
        setName(name.c_str());
        m_typeSize = 512;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }
    bool serialize(void *data, rtps::SerializedPayload_t *payload) override
    {
        const auto &bytes = *static_cast<Bytes *>(data);
        if (bytes.size() < 4 || bytes.size() > payload->max_size) {
            return false;
        }
        std::memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = static_cast<std::uint32_t>(bytes.size());
        payload->encapsulation = bytes[1] == 0 ? CDR_BE : CDR_LE;
        return true;
    }
    bool deserialize(rtps::SerializedPayload_t *payload, void *data) override
    {
        static_cast<Bytes *>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<std::uint32_t()> getSerializedSizeProvider(void *data) override
    {
        return [data] { return static_cast<std::uint32_t>(static_cast<Bytes *>(data)->size()); };
    }
    void *createData() override { return new Bytes; }
    void deleteData(void *data) override { delete static_cast<Bytes *>(data); }
    bool getKey(void *, rtps::InstanceHandle_t *, bool) override { return false; }
};

void put(Bytes &to, const void *from, std::size_t n_bytes)
{
    const auto *bytes = static_cast<const std::uint8_t *>(from);
    to.insert(to.end(), bytes, bytes + n_bytes);
}

void put(Bytes &to, const rtps::GUID_t &guid)
{
    put(to, guid.guidPrefix.value, 12);
    put(to, guid.entityId.value, 4);
}

void put(Bytes &to, const rtps::SampleIdentity &identity)
{
    put(to, identity.writer_guid());
    const std::uint64_t number = identity.sequence_number().to64long();
    put(to, &number, 8);
}

rtps::SampleIdentity identity(const std::uint8_t *from)
{
    rtps::GUID_t guid;
    std::memcpy(guid.guidPrefix.value, from, 12);
    std::memcpy(guid.entityId.value, from + 12, 4);
    std::uint64_t number = 0;
    std::memcpy(&number, from + 16, 8);
    rtps::SampleIdentity made;
    made.writer_guid(guid);
    made.sequence_number(rtps::SequenceNumber_t(number));
    return made;
}

// Frames come from Fast DDS's threads and from ours.
void say(char kind, std::uint32_t number, const Bytes &head, const Bytes &body = {})
{
    static std::mutex one_at_a_time;
    const std::lock_guard<std::mutex> lock(one_at_a_time);
    const auto n_bytes = static_cast<std::uint32_t>(5 + head.size() + body.size());
    std::fwrite(&n_bytes, 4, 1, stdout);
    std::fputc(kind, stdout);
    std::fwrite(&number, 4, 1, stdout);
    std::fwrite(head.data(), 1, head.size(), stdout);
    std::fwrite(body.data(), 1, body.size(), stdout);
    std::fflush(stdout);
}

void say_matched(std::uint32_t number, std::int32_t count)
{
    Bytes head;
    put(head, &count, 4);
    say('N', number, head);
}

struct Reading : fast::DataReaderListener {
    explicit Reading(std::uint32_t of) : number(of) {}
    void on_data_available(fast::DataReader *reader) override
    {
        Bytes body;
        fast::SampleInfo info;
        while (reader->take_next_sample(&body, &info) == ReturnCode_t::RETCODE_OK) {
            if (info.valid_data) {
                Bytes head;
                put(head, info.sample_identity);
                put(head, info.related_sample_identity);
                say('M', number, head, body);
            }
        }
    }
    void on_subscription_matched(fast::DataReader *, const fast::SubscriptionMatchedStatus &status) override
    {
        say_matched(number, status.current_count);
    }
    std::uint32_t number;
};

struct Writing : fast::DataWriterListener {
    explicit Writing(std::uint32_t of) : number(of) {}
    void on_publication_matched(fast::DataWriter *, const fast::PublicationMatchedStatus &status) override
    {
        say_matched(number, status.current_count);
    }
    std::uint32_t number;
};

// As rmw_fastrtps sets what ROS 2 asks for.
template <class Qos>
void set(Qos &qos, const std::uint8_t *asked)
{
    std::int32_t depth = 0;
    std::memcpy(&depth, asked + 2, 4);
    qos.reliability().kind = asked[0] != 0 ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = asked[1] != 0 ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = depth;
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    qos.data_sharing().off();
}

class Peer {
public:
    Peer(std::uint32_t domain, bool with_shared_memory)
    {
        fast::DomainParticipantQos qos;
        qos.name("/");
        const char enclave[] = "enclave=/;";
        qos.user_data().assign(enclave, enclave + sizeof enclave - 1);
        qos.transport().use_builtin_transports = false;
        const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
        udp->interfaceWhiteList.emplace_back("127.0.0.1");
        udp->maxInitialPeersRange = MAX_PARTICIPANTS;
        qos.transport().user_transports.push_back(udp);
        if (with_shared_memory) {
            const auto memory = std::make_shared<eprosima::fastdds::rtps::SharedMemTransportDescriptor>();
            memory->segment_size(2 << 20);
            qos.transport().user_transports.push_back(memory);
        }
        // Not every machine has multicast on its loopback.
        rtps::Locator_t here;
        rtps::IPLocator::setIPv4(here, 127, 0, 0, 1);
        qos.wire_protocol().builtin.initialPeersList.push_back(here);
        auto *factory = fast::DomainParticipantFactory::get_instance();
        participant = must(factory->create_participant(domain, qos), "no participant");
        subscriber = must(participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT), "no subscriber");
        publisher = must(participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT), "no publisher");
    }
    ~Peer()
    {
        participant->delete_contained_entities();
        fast::DomainParticipantFactory::get_instance()->delete_participant(participant);
    }
    Peer(const Peer &) = delete;
    Peer &operator=(const Peer &) = delete;

    void take(const Bytes &frame)
    {
        std::uint32_t number = 0;
        std::memcpy(&number, frame.data() + 1, 4);
        const std::uint8_t *body = frame.data() + 5;
        if (frame[0] == 'S') {
            write(number, body, frame.data() + frame.size());
        } else {
            Bytes head;
            put(head, frame[0] == 'R' ? make_reader(number, body) : make_writer(number, body));
            say('C', number, head);
        }
    }

private:
    fast::Topic *topic(const std::uint8_t *asked)
    {
        const std::string name(reinterpret_cast<const char *>(asked + 6));
        const std::string type(reinterpret_cast<const char *>(asked + 6 + name.size() + 1));
        if (participant->find_type(type).empty()) {
            participant->register_type(fast::TypeSupport(new Raw(type)));
        }
        auto *known = dynamic_cast<fast::Topic *>(participant->lookup_topicdescription(name));
        return known != nullptr ? known
                                : must(participant->create_topic(name, type, fast::TOPIC_QOS_DEFAULT), "no topic");
    }
    const rtps::GUID_t &make_reader(std::uint32_t number, const std::uint8_t *asked)
    {
        fast::DataReaderQos qos;
        set(qos, asked);
        readers.push_back(std::make_unique<Reading>(number));
        return must(subscriber->create_datareader(topic(asked), qos, readers.back().get()), "no reader")->guid();
    }
    const rtps::GUID_t &make_writer(std::uint32_t number, const std::uint8_t *asked)
    {
        fast::DataWriterQos qos;
        set(qos, asked);
        qos.publish_mode().kind = fast::SYNCHRONOUS_PUBLISH_MODE;
        listeners.push_back(std::make_unique<Writing>(number));
        writers[number] = must(publisher->create_datawriter(topic(asked), qos, listeners.back().get()), "no writer");
        return writers[number]->guid();
    }
    void write(std::uint32_t number, const std::uint8_t *body, const std::uint8_t *end)
    {
        Bytes bytes(body + IDENTITY_BYTES, end);
        rtps::WriteParams parameters;
        const auto related = identity(body);
        const bool has_identity = related.writer_guid() != rtps::GUID_t::unknown();
        if (has_identity) {
            parameters.related_sample_identity(related);
        }
        if (!writers.at(number)->write(&bytes, parameters)) {
            std::fprintf(stderr, "a message of %zu bytes was not written\n", bytes.size());
        }
        if (has_identity) {
            Bytes head;
            put(head, parameters.sample_identity());
            say('I', number, head);
        }
    }

    fast::DomainParticipant *participant = nullptr;
    fast::Subscriber *subscriber = nullptr;
    fast::Publisher *publisher = nullptr;
    std::map<std::uint32_t, fast::DataWriter *> writers;
    std::vector<std::unique_ptr<Reading>> readers;
    std::vector<std::unique_ptr<Writing>> listeners;
};

}  // namespace

int main(int n_words, char **words)
{
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
        const bool is_udp_only = n_words > 2 && std::strcmp(words[2], "udp") == 0;
        Peer peer(static_cast<std::uint32_t>(std::atoi(n_words > 1 ? words[1] : "0")), !is_udp_only);
        std::uint32_t n_bytes = 0;
        while (std::fread(&n_bytes, 4, 1, stdin) == 1) {
            Bytes frame(n_bytes);
            if (n_bytes < 5 || std::fread(frame.data(), 1, n_bytes, stdin) != n_bytes) {
                throw std::runtime_error("a frame that is cut off");
            }
            peer.take(frame);
        }
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
