#include "shape_type.hpp"

#include <cstring>

#include <fastrtps/utils/md5.h>

using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::octet;
using eprosima::fastrtps::rtps::SerializedPayload_t;

namespace {

constexpr uint8_t CDR_BE_ID = 0x00;
constexpr uint8_t CDR_LE_ID = 0x01;
constexpr uint32_t ENCAPSULATION_SIZE = 4;
constexpr uint32_t COLOR_MAX = 128;

class Encoder {
public:
    void put(uint32_t value)
    {
        bytes.resize((bytes.size() + 3) / 4 * 4);
        for (int shift = 0; shift < 32; shift += 8)
            bytes.push_back(static_cast<uint8_t>(value >> shift));
    }

    void put(const std::string& text)
    {
        put(static_cast<uint32_t>(text.size() + 1));
        bytes.insert(bytes.end(), text.begin(), text.end());
        bytes.push_back(0);
    }

    std::vector<uint8_t> bytes;
};

class Decoder {
public:
    Decoder(const uint8_t* bytes, uint32_t length, bool little_endian)
        : bytes_(bytes), length_(length), little_endian_(little_endian)
    {
    }

    bool get(uint32_t& value)
    {
        uint32_t at = (offset_ + 3) / 4 * 4;
        if (at > length_ || length_ - at < 4)
            return false;
        value = 0;
        for (uint32_t i = 0; i < 4; i++)
            value |= static_cast<uint32_t>(bytes_[at + i]) << (little_endian_ ? 8 * i : 24 - 8 * i);
        offset_ = at + 4;
        return true;
    }

    bool get(int32_t& value)
    {
        uint32_t raw = 0;
        bool whole = get(raw);
        value = static_cast<int32_t>(raw);
        return whole;
    }

    bool get(std::string& text)
    {
        uint32_t size = 0;
        if (!get(size) || size == 0 || size > length_ - offset_ || bytes_[offset_ + size - 1] != 0)
            return false;
        text.assign(reinterpret_cast<const char*>(bytes_ + offset_), size - 1);
        offset_ += size;
        return true;
    }

    bool get(std::vector<uint8_t>& octets)
    {
        uint32_t size = 0;
        if (!get(size) || size > length_ - offset_)
            return false;
        octets.assign(bytes_ + offset_, bytes_ + offset_ + size);
        offset_ += size;
        return true;
    }

private:
    const uint8_t* bytes_;
    uint32_t length_;
    bool little_endian_;
    uint32_t offset_ = 0;
};

std::vector<uint8_t> encode(const ShapeType& shape)
{
    Encoder encoder;
    encoder.put(shape.color);
    encoder.put(static_cast<uint32_t>(shape.x));
    encoder.put(static_cast<uint32_t>(shape.y));
    encoder.put(static_cast<uint32_t>(shape.shapesize));
    encoder.put(static_cast<uint32_t>(shape.additional_payload_size.size()));
    encoder.bytes.insert(encoder.bytes.end(), shape.additional_payload_size.begin(),
                         shape.additional_payload_size.end());
    return encoder.bytes;
}

uint32_t padded(uint32_t size)
{
    return (size + 3) / 4 * 4;
}

} // namespace

ShapeTypeSupport::ShapeTypeSupport(uint32_t additional_payload)
{
    setName("ShapeType");
    m_isGetKeyDefined = true;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
    m_typeSize = padded(ENCAPSULATION_SIZE + 4 + COLOR_MAX + 4 + 4 * 4 + additional_payload);
}

bool ShapeTypeSupport::serialize(void* data, SerializedPayload_t* payload)
{
    std::vector<uint8_t> body = encode(*static_cast<ShapeType*>(data));
    uint32_t length = padded(ENCAPSULATION_SIZE + static_cast<uint32_t>(body.size()));
    if (length > payload->max_size)
        return false;
    std::memset(payload->data, 0, length);
    payload->encapsulation = CDR_LE;
    payload->data[1] = CDR_LE_ID;
    // The number of padding octets behind the body (XTypes 1.3, 7.6.3.1.2).
    payload->data[3] = static_cast<octet>(length - ENCAPSULATION_SIZE - body.size());
    std::memcpy(payload->data + ENCAPSULATION_SIZE, body.data(), body.size());
    payload->length = length;
    return true;
}

bool ShapeTypeSupport::deserialize(SerializedPayload_t* payload, void* data)
{
    if (payload->length < ENCAPSULATION_SIZE || payload->data[0] != 0)
        return false;
    uint8_t id = payload->data[1];
    if (id != CDR_BE_ID && id != CDR_LE_ID)
        return false;
    Decoder decoder(payload->data + ENCAPSULATION_SIZE, payload->length - ENCAPSULATION_SIZE,
                    id == CDR_LE_ID);
    auto& shape = *static_cast<ShapeType*>(data);
    return decoder.get(shape.color) && decoder.get(shape.x) && decoder.get(shape.y) &&
           decoder.get(shape.shapesize) && decoder.get(shape.additional_payload_size);
}

std::function<uint32_t()> ShapeTypeSupport::getSerializedSizeProvider(void* data)
{
    return [data]() {
        auto size = encode(*static_cast<ShapeType*>(data)).size();
        return padded(ENCAPSULATION_SIZE + static_cast<uint32_t>(size));
    };
}

void* ShapeTypeSupport::createData()
{
    return new ShapeType();
}

void ShapeTypeSupport::deleteData(void* data)
{
    delete static_cast<ShapeType*>(data);
}

// The key may be longer than 16 octets, so the handle is always the MD5 of the big-endian key
// (RTPS 2.5, 9.6.4.8).
bool ShapeTypeSupport::getKey(void* data, InstanceHandle_t* handle, bool /*force_md5*/)
{
    const std::string& color = static_cast<ShapeType*>(data)->color;
    auto size = static_cast<uint32_t>(color.size() + 1);
    const uint8_t prefix[4] = {static_cast<uint8_t>(size >> 24), static_cast<uint8_t>(size >> 16),
                               static_cast<uint8_t>(size >> 8), static_cast<uint8_t>(size)};
    MD5 md5;
    md5.init();
    md5.update(prefix, sizeof prefix);
    md5.update(color.c_str(), size);
    md5.finalize();
    for (uint8_t i = 0; i < 16; i++)
        handle->value[i] = md5.digest[i];
    return true;
}
