// Passes the metadata of the object table to Python.
#include <pybind11/pybind11.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "firmware/objects/generated/axis_objects_meta.h"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/item.hpp"

extern "C" {
#include "firmware/core/certificate.h"
#include "firmware/objects/generated/axis_objects_meta.h"
}

namespace py = pybind11;
using forceaxis::host::item;
using forceaxis::host::Within;

namespace {

struct ObjectBit {
  static constexpr const char *kName = "ObjectBit";
  static constexpr const char *kMeaning = "One bit of an object whose value is a set of bits.";
  axis_object_bit_t b;

  table::Fixed<int> modes() const {
    table::Fixed<int> all;
    for (int mode = -16; mode < 16; ++mode)
      if ((b.modes >> (mode + 16) & 1U) != 0) all.values.push_back(mode);
    return all;
  }
  static constexpr auto items() {
    using B = axis_object_bit_t;
    constexpr auto b = &ObjectBit::b;
    return std::tuple{item("bit", Within{b, &B::bit}), item("key", Within{b, &B::key}),
                      item("text", Within{b, &B::text}),
                      item("modes", &ObjectBit::modes,
                           "modes of operation in which the bit has this meaning; empty for all")};
  }
};

struct AxisObject {
  static constexpr const char *kName = "AxisObject";
  static constexpr const char *kMeaning =
      "One parameter, signal or command of the firmware. The engineering value is the raw value "
      "times `scale`.";
  axis_object_meta_t o;

  template <class T>
  struct As {
    int axis_object_meta_t::*member;
    T operator()(const AxisObject &object) const { return static_cast<T>(object.o.*member); }
  };
  table::Fixed<std::string> texts() const {
    table::Fixed<std::string> all;
    std::string_view rest = o.enum_texts;
    while (!rest.empty()) {
      const std::size_t comma = rest.find(',');
      all.values.emplace_back(rest.substr(0, comma));
      rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
    }
    return all;
  }
  table::Fixed<std::tuple<std::int32_t, std::string>> values() const {
    table::Fixed<std::tuple<std::int32_t, std::string>> all;
    for (const axis_value_text_t &named : axis_value_texts)
      if (named.object == o.object) all.values.emplace_back(named.value, named.text);
    return all;
  }
  table::Fixed<std::string> sentences() const {
    table::Fixed<std::string> all;
    for (const axis_value_text_t &named : axis_value_texts)
      if (named.object == o.object) all.values.emplace_back(named.sentence);
    return all;
  }
  table::Fixed<ObjectBit> bits() const {
    table::Fixed<ObjectBit> all;
    for (const axis_object_bit_t &bit : axis_object_bits)
      if (bit.object == o.object) all.values.push_back({bit});
    return all;
  }

  static constexpr auto items() {
    using M = axis_object_meta_t;
    constexpr auto o = &AxisObject::o;
    return std::tuple{
        item("number", Within{o, &M::object}),
        item("name", Within{o, &M::name}),
        item("kind", Within{o, &M::kind}, "parameter, signal or command"),
        item("part", Within{o, &M::part}),
        item("meaning", Within{o, &M::meaning}),
        item("type", Within{o, &M::type}, "u8, i8, u16, i16, u32 or i32"),
        item("unit", Within{o, &M::unit}, "unit of the engineering value"),
        item("scale", Within{o, &M::scale}),
        item("min", Within{o, &M::min}, "smallest raw value"),
        item("max", Within{o, &M::max}, "largest raw value"),
        item("default", Within{o, &M::initial}, "raw value after power-up"),
        item("access", Within{o, &M::access}, "rw, ro or wo"),
        item("writable", Within{o, &M::writable},
             "states in which the object can be written: any, disabled or recorder_idle"),
        item("enum", &AxisObject::texts, "texts of the raw values 0, 1, 2, ..."),
        item("index", Within{o, &M::index}, "CANopen index"),
        item("sub", Within{o, &M::sub}),
        item("modbus", Within{o, &M::modbus},
             "first register: holding register for rw, input register for ro; -1 without a "
             "register"),
        item("stored", As<bool>{&M::stored}, "True if the parameter store contains the object"),
        item("title", Within{o, &M::title}, "name of the object in CANopen"),
        item("node_id", As<bool>{&M::node_id},
             "True for a COB-ID whose default value is a number plus the node id"),
        item("mappable", Within{o, &M::mappable},
             "0: in no PDO, 1: in all PDOs that its access permits, 2: in TPDOs only"),
        item("quantity", Within{o, &M::quantity},
             "quantity of a count: force or encoder; empty if the unit defines the quantity"),
        item("in_cycle", Within{o, &M::in_cycle},
             "effect of a write while a cycle runs: free (none), ends (ends the cycle), refused"),
        item("values", &AxisObject::values,
             "names of special raw values, for an object that is not an enumeration"),
        item("sentences", &AxisObject::sentences,
             "a sentence for each named value, such as the cause of a fault; empty without a "
             "sentence"),
        item("bits", &AxisObject::bits, "bits of a value that is, or contains, a set of bits")};
  }
};

struct AxisBit {
  static constexpr const char *kName = "AxisBit";
  static constexpr const char *kMeaning = "One coil or discrete input of the Modbus server.";
  axis_bit_meta_t b;

  static constexpr auto items() {
    using B = axis_bit_meta_t;
    constexpr auto b = &AxisBit::b;
    return std::tuple{item("address", Within{b, &B::address}), item("name", Within{b, &B::name}),
                      item("meaning", Within{b, &B::meaning})};
  }
};

struct StatusState {
  static constexpr const char *kName = "StatusState";
  static constexpr const char *kMeaning =
      "A state of CiA 402: a statusword shows it if its bits in `mask` are `value`.";
  axis_status_state_t s;

  static constexpr auto items() {
    using S = axis_status_state_t;
    constexpr auto s = &StatusState::s;
    return std::tuple{item("mask", Within{s, &S::mask}), item("value", Within{s, &S::value}),
                      item("text", Within{s, &S::text})};
  }
};

struct Refusal {
  static constexpr const char *kName = "Refusal";
  static constexpr const char *kMeaning =
      "Reason for which the firmware refuses an access to an object.";
  axis_refusal_t r;

  table::Fixed<std::uint32_t> aborts() const {
    table::Fixed<std::uint32_t> all;
    for (const std::uint32_t abort : r.aborts)
      if (abort != 0) all.values.push_back(abort);
    return all;
  }
  static constexpr auto items() {
    using R = axis_refusal_t;
    constexpr auto r = &Refusal::r;
    return std::tuple{item("error", Within{r, &R::error}, "number in the firmware"),
                      item("name", Within{r, &R::name}),
                      item("text", Within{r, &R::text}, "text for the user"),
                      item("aborts", &Refusal::aborts,
                           "SDO abort codes with which the axis reports this refusal")};
  }
};

// Returns a list of the rows of a C table, each as a Row.
template <class Row, class C, std::size_t Count>
py::object list_of(const C (&rows)[Count]) {
  std::vector<Row> all;
  for (const C &row : rows) all.push_back({row});
  return table::object(all);
}

struct Certificate {
  static constexpr const char *kName = "CertificateValues";
  static constexpr const char *kMeaning = "Raw values of the certificate of a bank.";
  static constexpr bool kDict = true;
  certificate_t c;

  static constexpr auto items() {
    constexpr auto c = &Certificate::c;
    return std::tuple{item("certificate_hash", Within{c, &certificate_t::hash}),
                      item("certificate_parts", Within{c, &certificate_t::parts})};
  }
};

}  // namespace

void add_objects(py::module_ &m) {
  table::add_results<ObjectBit, AxisObject, AxisBit, StatusState, Refusal, Certificate>();
  m.attr("OBJECTS_HASH") = AXIS_OBJECTS_HASH;
  m.def(
      "objects", [] { return list_of<AxisObject>(axis_objects_meta); },
      "Returns the object table in the order of the numbers.");
  m.def(
      "status_states", [] { return list_of<StatusState>(axis_status_states); },
      "Returns the states of CiA 402.");
  m.def(
      "refusals", [] { return list_of<Refusal>(axis_refusals); },
      "Returns the results of a refused access.");
  m.def(
      "certificate",
      [](std::uint32_t bank_crc, std::uint8_t adc_bits, std::uint32_t force_scale) {
        return table::object(Certificate{certificate_of(bank_crc, adc_bits, force_scale)});
      },
      py::arg("bank_crc"), py::arg("adc_bits"), py::arg("force_scale"),
      "Returns the values of the certificate of a bank.");
  m.def(
      "coils", [] { return list_of<AxisBit>(axis_coils_meta); }, "Returns all Modbus coils.");
  m.def(
      "discretes", [] { return list_of<AxisBit>(axis_discretes_meta); },
      "Returns all discrete inputs of Modbus.");
}
