// What Fast DDS makes of serialized samples, by Fast-CDR: each type with the calls that Fast DDS-Gen makes of its IDL.
// Requests and answers are those of codec.c; Fast-CDR 1 knows XCDR1 alone, so the types are without extensibility.
#include <array>
#include <cstdint>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastcdr/exceptions/Exception.h>

using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

namespace {

enum Wanted { SAMPLE, KEY, BIG_ENDIAN_KEY };

struct Inner {
    uint8_t tag;
    double b;
    void serialize(Cdr& c) const { c << tag << b; }
    void deserialize(Cdr& c) { c >> tag >> b; }
};

struct Point {
    int32_t x;
    int16_t y;
    void serialize(Cdr& c) const { c << x << y; }
    void deserialize(Cdr& c) { c >> x >> y; }
};

struct Number {
    uint32_t d;
    int64_t num;
    std::string text;
    Inner inner;
    void serialize(Cdr& c) const {
        c << d;
        switch (d) {
            case 0: c << num; break;
            case 1: c << text; break;
            default: c << inner; break;
        }
    }
    void deserialize(Cdr& c) {
        c >> d;
        switch (d) {
            case 0: c >> num; break;
            case 1: c >> text; break;
            default: c >> inner; break;
        }
    }
};

struct Choice {
    uint8_t d;
    float f;
    std::vector<std::string> texts;
    void serialize(Cdr& c) const {
        c << d;
        if (d == 1) c << f;
        else c << texts;
    }
    void deserialize(Cdr& c) {
        c >> d;
        if (d == 1) c >> f;
        else c >> texts;
    }
};

struct Plain {
    int64_t id;
    std::string name;
    bool flag;
    char letter;
    uint8_t byte;
    int16_t s;
    uint32_t ul;
    uint64_t ull;
    float f;
    double d;
    std::string short_name;
    std::vector<int16_t> shorts;
    std::vector<std::string> strings;
    std::vector<double> doubles;
    std::vector<std::vector<uint8_t>> nested;
    std::array<std::array<int32_t, 3>, 2> matrix;
    std::array<Inner, 2> inner_array;
    std::vector<Inner> inners;
    uint32_t tint;
    uint8_t small;
    std::vector<uint32_t> colors;
    Number number;
    void serialize(Cdr& c) const {
        c << id << name << flag << letter << byte << s << ul << ull << f << d << short_name << shorts << strings
          << doubles << nested << matrix << inner_array << inners << tint << small << colors << number;
    }
    void deserialize(Cdr& c) {
        c >> id >> name >> flag >> letter >> byte >> s >> ul >> ull >> f >> d >> short_name >> shorts >> strings
          >> doubles >> nested >> matrix >> inner_array >> inners >> tint >> small >> colors >> number;
    }
    void serialize_key(Cdr& c) const { c << id; }
};

struct Collections {
    std::map<uint16_t, std::string> names;
    std::map<uint8_t, float> ratios;
    std::map<std::string, Point> places;
    std::vector<Point> points;
    Choice picked;
    uint16_t flags;
    void serialize(Cdr& c) const { c << names << ratios << places << points << picked << flags; }
    void deserialize(Cdr& c) { c >> names >> ratios >> places >> points >> picked >> flags; }
    void serialize_key(Cdr&) const {}
};

struct Located {
    double altitude;
    uint64_t serial;
    uint8_t row;
    std::string note;
    uint16_t column;
    void serialize(Cdr& c) const { c << altitude << serial << row << note << column; }
    void deserialize(Cdr& c) { c >> altitude >> serial >> row >> note >> column; }
    void serialize_key(Cdr& c) const { c << serial << row << column; }
};

struct Named {
    int32_t value;
    std::string name;
    uint32_t tint;
    void serialize(Cdr& c) const { c << value << name << tint; }
    void deserialize(Cdr& c) { c >> value >> name >> tint; }
    void serialize_key(Cdr& c) const { c << name << tint; }
};

void answer(const char* bytes, uint32_t size) {
    fwrite(&size, sizeof(size), 1, stdout);
    if (bytes != nullptr) fwrite(bytes, 1, size, stdout);
    fflush(stdout);
}

template <typename T>
void convert(const unsigned char* request, std::vector<char>& data) {
    const auto order = request[2] || request[3] == BIG_ENDIAN_KEY ? Cdr::BIG_ENDIANNESS : Cdr::LITTLE_ENDIANNESS;
    try {
        FastBuffer from(data.data(), data.size());
        Cdr in(from, request[2] ? Cdr::BIG_ENDIANNESS : Cdr::LITTLE_ENDIANNESS);
        T sample{};
        sample.deserialize(in);
        // It passes over padding without a write. A sample in the other byte order is no longer.
        std::vector<char> zeros(data.size() + 8);
        FastBuffer to(zeros.data(), zeros.size());
        Cdr out(to, order);
        if (request[3] == SAMPLE) sample.serialize(out);
        else sample.serialize_key(out);
        answer(to.getBuffer(), static_cast<uint32_t>(out.getSerializedDataLength()));
    } catch (eprosima::fastcdr::exception::Exception&) {
        answer(nullptr, UINT32_MAX);
    }
}

}  // namespace

int main() {
    unsigned char request[4];
    uint32_t size;
    while (fread(request, 1, 4, stdin) == 4 && fread(&size, sizeof(size), 1, stdin) == 1) {
        std::vector<char> data(size);
        if (fread(data.data(), 1, size, stdin) != size) return 1;
        switch (request[0]) {
            case 0: convert<Plain>(request, data); break;
            case 3: convert<Located>(request, data); break;
            case 4: convert<Named>(request, data); break;
            case 5: convert<Collections>(request, data); break;
            default: answer(nullptr, UINT32_MAX);
        }
    }
}
