// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_request.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr int kMostNested = 8;  ///< what is written deeper would take the stack

}  // namespace

json parse_admin_request(const std::string& text) {
  bool is_deep = false;
  const auto keep = [&is_deep](int depth, json::parse_event_t, json&) {
    is_deep = is_deep || depth > kMostNested;
    return depth <= kMostNested;
  };
  json request = json::parse(text, keep, false);
  return is_deep || !request.is_object() ? json() : request;
}

namespace asked {

std::string text_of(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_string() ? it->get<std::string>() : std::string();
}

uint64_t number_of(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_number_unsigned() ? it->get<uint64_t>() : 0;
}

bool is_set(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_boolean() && it->get<bool>();
}

}  // namespace asked

}  // namespace cairn
