// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace cairn {

static_assert(std::endian::native == std::endian::little, "rows are little-endian");

/// Numbers in a row's blob, one after another, little-endian, without padding.
class ByteWriter {
 public:
  template <typename Number>
  requires std::is_arithmetic_v<Number>
  void put(Number value) {
    const size_t at = bytes_.size();
    bytes_.resize(at + sizeof(value));
    std::memcpy(bytes_.data() + at, &value, sizeof(value));
  }
  template <typename Vector>
  requires requires(const Vector& v) { v.size(), v.data(), typename Vector::Scalar(); }
  void put(const Vector& vector) {
    for (const auto value : vector) put(value);
  }
  void put(std::span<const uint8_t> raw) { bytes_.insert(bytes_.end(), raw.begin(), raw.end()); }
  void put_text(const std::string& text) {
    put(static_cast<uint32_t>(text.size()));
    const size_t at = bytes_.size();
    bytes_.resize(at + text.size());
    if (!text.empty()) std::memcpy(bytes_.data() + at, text.data(), text.size());
  }
  [[nodiscard]] std::vector<uint8_t> take() { return std::move(bytes_); }

 private:
  std::vector<uint8_t> bytes_;
};

/// Reads what a ByteWriter wrote. Beyond the end it gives zeros and is no longer good().
class ByteReader {
 public:
  explicit ByteReader(std::span<const uint8_t> bytes) : rest_(bytes) {}

  template <typename Number>
  requires std::is_arithmetic_v<Number> Number get() {
    Number value{};
    if (!has(sizeof(value))) return value;
    std::memcpy(&value, rest_.data(), sizeof(value));
    rest_ = rest_.subspan(sizeof(value));
    return value;
  }
  template <typename Vector>
  Vector get_vector() {
    Vector vector;
    for (auto& value : vector) value = get<typename Vector::Scalar>();
    return vector;
  }
  void get(std::span<uint8_t> out) {
    if (!has(out.size()) || out.empty()) return;
    std::memcpy(out.data(), rest_.data(), out.size());
    rest_ = rest_.subspan(out.size());
  }
  /// A count of things of at least `bytes_each`: 0, and no longer good, when they cannot all be there.
  size_t get_count(size_t bytes_each) {
    const size_t count = get<uint32_t>();
    return has(count * bytes_each) ? count : 0;
  }
  std::string get_text() {
    const size_t size = get_count(1);
    std::string text(reinterpret_cast<const char*>(rest_.data()), size);
    rest_ = rest_.subspan(size);
    return text;
  }
  [[nodiscard]] bool good() const { return good_; }
  [[nodiscard]] size_t left() const { return good_ ? rest_.size() : 0; }
  /// Good, and nothing is left.
  [[nodiscard]] bool finished() const { return good_ && rest_.empty(); }

 private:
  bool has(size_t bytes) {
    good_ = good_ && bytes <= rest_.size();
    return good_;
  }
  std::span<const uint8_t> rest_;
  bool good_ = true;
};

}  // namespace cairn
