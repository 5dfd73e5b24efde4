// Passes the metadata of the object table to Python. forceaxis.objects converts the metadata to
// named tuples.
#include <pybind11/pybind11.h>

#include <string_view>

#include "firmware/objects/generated/axis_objects_meta.h"
#include "firmware/port/host/firmware.hpp"
#include "host/python/binding/parts.hpp"

namespace py = pybind11;

namespace {

py::tuple enum_texts(const axis_object_meta_t &meta) {
  py::list texts;
  std::string_view rest = meta.enum_texts;
  while (!rest.empty()) {
    const std::size_t comma = rest.find(',');
    texts.append(rest.substr(0, comma));
    rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
  }
  return py::tuple(texts);
}

py::tuple value_texts(const axis_object_meta_t &meta) {
  py::list texts;
  for (const axis_value_text_t &named : axis_value_texts) {
    if (named.object == meta.object) texts.append(py::make_tuple(named.value, named.text));
  }
  return py::tuple(texts);
}

py::tuple sentences(const axis_object_meta_t &meta) {
  py::list texts;
  for (const axis_value_text_t &named : axis_value_texts) {
    if (named.object == meta.object) texts.append(named.sentence);
  }
  return py::tuple(texts);
}

// (bit, key, text, modes of operation) of an object whose value is a set of bits.
py::tuple bits_of(const axis_object_meta_t &meta) {
  py::list found;
  for (const axis_object_bit_t &bit : axis_object_bits) {
    if (bit.object != meta.object) continue;
    py::list modes;
    for (int mode = -16; mode < 16; ++mode)
      if ((bit.modes >> (mode + 16) & 1U) != 0) modes.append(mode);
    found.append(py::make_tuple(bit.bit, bit.key, bit.text, py::tuple(modes)));
  }
  return py::tuple(found);
}

py::list objects() {
  using namespace py::literals;
  py::list found;
  for (const axis_object_meta_t &meta : axis_objects_meta) {
    found.append(py::dict(
        "number"_a = meta.object, "name"_a = meta.name, "kind"_a = meta.kind, "part"_a = meta.part,
        "meaning"_a = meta.meaning, "type"_a = meta.type, "unit"_a = meta.unit,
        "scale"_a = meta.scale, "min"_a = meta.min, "max"_a = meta.max, "default"_a = meta.initial,
        "access"_a = meta.access, "writable"_a = meta.writable, "enum"_a = enum_texts(meta),
        "index"_a = meta.index, "sub"_a = meta.sub, "modbus"_a = meta.modbus,
        "stored"_a = meta.stored != 0, "title"_a = meta.title, "node_id"_a = meta.node_id != 0,
        "mappable"_a = meta.mappable, "quantity"_a = meta.quantity, "in_cycle"_a = meta.in_cycle,
        "values"_a = value_texts(meta), "sentences"_a = sentences(meta), "bits"_a = bits_of(meta)));
  }
  return found;
}

template <std::size_t Count>
py::list bits(const axis_bit_meta_t (&table)[Count]) {
  using namespace py::literals;
  py::list found;
  for (const axis_bit_meta_t &bit : table) {
    found.append(
        py::dict("address"_a = bit.address, "name"_a = bit.name, "meaning"_a = bit.meaning));
  }
  return found;
}

py::list status_states() {
  py::list found;
  for (const axis_status_state_t &state : axis_status_states)
    found.append(py::make_tuple(state.mask, state.value, state.text));
  return found;
}

py::list refusals() {
  py::list found;
  for (const axis_refusal_t &refusal : axis_refusals) {
    py::list aborts;
    for (const std::uint32_t abort : refusal.aborts)
      if (abort != 0) aborts.append(abort);
    found.append(py::make_tuple(refusal.error, refusal.name, refusal.text, py::tuple(aborts)));
  }
  return found;
}

py::dict certificate(std::uint32_t bank_crc, std::uint8_t adc_bits, std::uint32_t force_scale) {
  using namespace py::literals;
  const certificate_t certificate = certificate_of(bank_crc, adc_bits, force_scale);
  return py::dict("certificate_hash"_a = certificate.hash,
                  "certificate_parts"_a = certificate.parts);
}

}  // namespace

void add_objects(py::module_ &m) {
  m.attr("OBJECTS_HASH") = AXIS_OBJECTS_HASH;
  m.def("objects", &objects,
        "Returns the object table as one dictionary for each object, in the order of the numbers.");
  m.def("status_states", &status_states, "Returns (mask, value, text) of each state of CiA 402.");
  m.def("refusals", &refusals,
        "Returns (error, name, text, SDO abort codes) of each result of a refused access.");
  m.def("certificate", &certificate, py::arg("bank_crc"), py::arg("adc_bits"),
        py::arg("force_scale"), "Returns the values of the certificate of a bank.");
  m.def(
      "coils", [] { return bits(axis_coils_meta); },
      "Returns address, name and meaning of all Modbus coils.");
  m.def(
      "discretes", [] { return bits(axis_discretes_meta); },
      "Returns address, name and meaning of all discrete inputs of Modbus.");
}
