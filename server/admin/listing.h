// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

/// What a server answers, as rows for people on stdout. Texts in it are of strangers: archives and peers
/// bring them. Columns are as wide as a terminal shows them.
namespace cairn {

/// The member `key`, empty where there is none, safe for a terminal.
[[nodiscard]] std::string text_of(const nlohmann::json& object, const char* key);

/// The member `key`; 0 where there is none, or one that is no whole number from 0 on.
[[nodiscard]] uint64_t count_of(const nlohmann::json& object, const char* key);

void print_map(const nlohmann::json& map);
/// Prints all that `show` has of a map.
void print_whole_map(const nlohmann::json& map);
void print_deleted(const nlohmann::json& map);
void print_damaged(const nlohmann::json& file);
void print_unloaded(const nlohmann::json& map);
void print_rig(const nlohmann::json& rig);
void print_label(const nlohmann::json& label);

}  // namespace cairn
