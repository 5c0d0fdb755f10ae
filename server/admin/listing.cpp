// SPDX-License-Identifier: Apache-2.0
#include "server/admin/listing.h"

#include <cinttypes>
#include <cstdio>
#include <ctime>
#include <vector>

#include "common/base/utf8.h"

namespace cairn {

using nlohmann::json;

namespace {

constexpr size_t kNameColumns = 24;  ///< wide enough for most names of maps
constexpr size_t kTextColumns = 32;

/// A text ("?" if it is empty) padded to so many columns of a terminal, which are not the same number of
/// bytes.
std::string column_of(const std::string& text, size_t columns) {
  return padded(text.empty() ? "?" : text, columns);
}

}  // namespace

std::string text_of(const json& object, const char* key) {
  return one_line(object.value(key, ""));
}

uint64_t count_of(const json& object, const char* key) {
  const auto it = object.find(key);
  return it != object.end() && it->is_number_unsigned() ? it->get<uint64_t>() : 0;
}

void print_map(const json& map) {
  std::printf("%s %s  %5" PRIu64 " keyframes %7" PRIu64 " points %8.1f MB%s%s\n",
              column_of(text_of(map, "name"), kNameColumns).c_str(), text_of(map, "id").c_str(),
              count_of(map, "keyframes"), count_of(map, "points"), map.value("memory_bytes", 0.0) * 1e-6,
              map.value("at_rest", false) ? "  idle" : "", map.contains("failed") ? "  failed" : "");
  for (const char* trouble : {"failed", "frozen"}) {
    if (map.contains(trouble)) std::printf("%24s %s\n", "", text_of(map, trouble).c_str());
  }
  if (const std::string when = text_of(map, "localized"); !when.empty())
    std::printf("%24s last localized in %s, now by %" PRIu64 "\n", "", when.c_str(),
                count_of(map, "clients"));
  for (const json& overlap : map.value("overlaps", json::array()))
    std::printf("%24s overlaps %s: %" PRIu64 " of its keyframes show that map, %" PRIu64
                " of that map's show this\n",
                "", text_of(overlap, "map").c_str(), count_of(overlap, "keyframes"),
                count_of(overlap, "its_keyframes"));
}

void print_rig(const json& rig) {
  const json order = rig.value("last_order", json::object());
  const std::string commander = text_of(rig, "commander");
  std::printf("%s %s%s%s", column_of(text_of(rig, "rig"), kNameColumns).c_str(),
              rig.value("silent", false)    ? "silent, was: "
              : rig.value("stopped", false) ? "EMERGENCY STOP, "
                                            : "",
              text_of(rig, "mode").c_str(), rig.value("drives_idle", true) ? ", drives let go" : "");
  if (!commander.empty()) std::printf(", last commanded by %s", commander.c_str());
  std::printf("\n");
  if (!order.empty()) {
    const std::string refusal = text_of(order, "refusal");
    std::printf("%24s last order: %s, by %s%s%s\n", "", text_of(order, "mode").c_str(),
                text_of(order, "by").c_str(), refusal.empty() ? "" : ", refused: ", refusal.c_str());
  }
  const std::string trouble = text_of(rig, "trouble");
  if (!trouble.empty()) std::printf("%24s %s\n", "", trouble.c_str());
}

void print_whole_map(const json& map) {
  print_map(map);
  std::printf("epoch         %" PRIu64 ", revision %" PRIu64 "\n", count_of(map, "epoch"),
              count_of(map, "revision"));
  std::printf("plane         %s\n",
              map.value("plane_aligned", false) ? "the dominant one is Z = 0" : "none found");
  if (map.contains("reprojection_px"))
    std::printf("reprojection  %.2f px (root mean square)\n", map.value("reprojection_px", 0.0));
  for (const json& camera : map.value("cameras", json::array()))
    std::printf("camera        %" PRIu64 "x%" PRIu64 " %s, focal length %.1f px: %" PRIu64 " keyframes\n",
                count_of(camera, "width"), count_of(camera, "height"), text_of(camera, "model").c_str(),
                camera.value("focal_px", 0.0), count_of(camera, "keyframes"));
  std::printf("labels        %" PRIu64 "\n", count_of(map, "labels"));
}

void print_deleted(const json& map) {
  const std::string name = text_of(map, "name");
  const std::string id = text_of(map, "id");
  const bool damaged = map.contains("damaged");
  const char* problem = damaged ? "damaged" : "unreadable";
  const std::string why = text_of(map, problem);
  std::printf("%s %s  deleted, %.1f MB on disk%s%s\n", column_of(name, kNameColumns).c_str(), id.c_str(),
              map.value("bytes", 0.0) * 1e-6, why.empty() ? "" : ", ", why.empty() ? "" : problem);
  if (why.empty()) return;
  const std::string remedy = damaged ? "`cairnctl maps purge " + id + "` removes it" : "see to that";
  std::printf("%24s %s; %s\n", "", why.c_str(), remedy.c_str());
}

void print_damaged(const json& file) {
  const std::string name = text_of(file, "name");
  const std::string id = text_of(file, "id");
  std::printf("%s %-32s  damaged, set aside, %.1f MB: %s\n", column_of(name, kNameColumns).c_str(),
              id.c_str(), file.value("bytes", 0.0) * 1e-6, text_of(file, "file").c_str());
  if (!id.empty())
    std::printf("%24s %s\n", "",
                file.value("served", false) ? "what could be saved of it is served" : "not served");
  for (const json& reason : file.value("reasons", json::array()))
    std::printf("%24s %s\n", "", one_line(reason.get<std::string>()).c_str());
}

void print_unloaded(const json& map) {
  const std::string name = text_of(map, "name");
  std::printf("%s %s  not served: %s\n%24s %s\n", column_of(name, kNameColumns).c_str(),
              text_of(map, "id").c_str(), text_of(map, "file").c_str(), "", text_of(map, "reason").c_str());
  std::printf("%24s see to that and start the server again, or move the file away and import an archive\n",
              "");
}

void print_label(const json& label) {
  const auto seconds = static_cast<std::time_t>(count_of(label, "time") / 1'000'000'000);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char when[32];
  std::strftime(when, sizeof(when), "%Y-%m-%d %H:%M:%S", &parts);
  auto at = label.value("position", std::vector<double>());
  at.resize(3);
  std::printf("%s %4" PRIu64 "  %s by %s, %s UTC, at %.3f %.3f %.3f%s\n",
              column_of(text_of(label, "map"), kNameColumns).c_str(), count_of(label, "id"),
              column_of(text_of(label, "text"), kTextColumns).c_str(), text_of(label, "author").c_str(), when,
              at.at(0), at.at(1), at.at(2), label.value("kind", "") == "model" ? ", a model" : "");
}

}  // namespace cairn
