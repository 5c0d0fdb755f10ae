// SPDX-License-Identifier: Apache-2.0
#include "server/admin/watch_commands.h"

#include <unistd.h>

#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "common/io/json_text.h"
#include "server/admin/interruption.h"
#include "server/admin/listing.h"

namespace cairn {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

struct Words {
  bool once = false;
  double every = 2;  ///< [s]
};

/// What the table shows: the server's figures, and rates since the last look.
class Table {
 public:
  Result<json> look(AdminClient* client) {
    const auto status = client->ask({{"verb", "status"}});
    if (!status) return tl::unexpected(status.error());
    auto maps = client->maps();
    if (!maps) return tl::unexpected(maps.error());
    const auto clients = client->ask({{"verb", "clients"}});
    if (!clients) return tl::unexpected(clients.error());
    const Clock::time_point now = Clock::now();
    json rows = json::array();
    std::map<std::string, uint64_t> accepted;
    for (json& map : (*maps)["maps"]) {
      const std::string id = map.value("id", "");
      const uint64_t count = accepted[id] = count_of(map, "offers_accepted");
      if (const auto before = accepted_.find(id); before != accepted_.end() && count >= before->second) {
        const double seconds = std::chrono::duration<double>(now - looked_at_).count();
        map["keyframes_per_minute"] = 60 * static_cast<double>(count - before->second) / seconds;
      }
      rows.push_back(std::move(map));
    }
    accepted_ = std::move(accepted);
    looked_at_ = now;
    return json{{"status", status->content},
                {"maps", std::move(rows)},
                {"clients", clients->content.value("clients", json::array())}};
  }

 private:
  std::map<std::string, uint64_t> accepted_;
  Clock::time_point looked_at_;
};

std::string number_of(const json& row, const char* key, const char* format) {
  const auto found = row.find(key);
  if (found == row.end() || !found->is_number()) return "-";
  char text[32];
  std::snprintf(text, sizeof(text), format, found->get<double>());
  return text;
}

void print_table(const json& now) {
  const json& status = now["status"];
  std::printf("health %s, maps %" PRIu64 " (%" PRIu64 " idle), memory %.0f MB\n\n",
              text_of(status, "health").c_str(), count_of(status, "maps"), count_of(status, "maps_at_rest"),
              status.value("memory_bytes", 0.0) * 1e-6);
  std::printf("%-32s %9s %8s %7s %8s %12s\n", "MAP", "KEYFRAMES", "POINTS", "CLIENTS", "KF/MIN",
              "OFFER P50/95");
  for (const json& map : now["maps"]) {
    std::printf(
        "%-32s %9" PRIu64 " %8" PRIu64 " %7" PRIu64 " %8s %12s%s\n", text_of(map, "name").c_str(),
        count_of(map, "keyframes"), count_of(map, "points"), count_of(map, "clients"),
        number_of(map, "keyframes_per_minute", "%.1f").c_str(),
        (number_of(map, "offer_p50_ms", "%.0f") + "/" + number_of(map, "offer_p95_ms", "%.0f ms")).c_str(),
        map.contains("failed")   ? "  failed"
        : map.contains("frozen") ? "  frozen"
                                 : "");
  }
  std::printf("\n%-32s %-9s %-9s %8s %-32s %s\n", "CLIENT", "LINK", "STATE", "QUALITY", "MAP", "WEARER");
  for (const json& client : now["clients"]) {
    const char* link = client.value("revoked", false)     ? "revoked"
                       : client.value("blocked", false)   ? "blocked"
                       : client.value("connected", false) ? "connected"
                                                          : "away";
    const std::string state = text_of(client, "state");
    std::printf("%-32s %-9s %-9s %8s %-32s %s\n", text_of(client, "name").c_str(), link,
                state.empty() ? "-" : state.c_str(), number_of(client, "quality", "%.2f").c_str(),
                text_of(client, "map").c_str(), text_of(client, "wearer").c_str());
  }
}

/// One look has no rate before it: two, a moment apart.
Status show_once(AdminClient* client, bool as_json) {
  Table table;
  auto now = table.look(client);
  if (!now) return tl::unexpected(now.error());
  std::this_thread::sleep_for(std::chrono::seconds(1));
  now = table.look(client);
  if (!now) return tl::unexpected(now.error());
  if (as_json) {
    std::printf("%s\n", json_text(*now, 2).c_str());
  } else {
    print_table(*now);
  }
  return {};
}

Status show_on(AdminClient* client, const Words& words, bool as_json) {
  const Interruption interruption;
  client->stop_when(Interruption::requested);
  const bool is_terminal = isatty(STDOUT_FILENO) != 0;
  Table table;
  while (!Interruption::requested()) {
    const auto now = table.look(client);
    if (!now) return Interruption::requested() ? Status() : tl::unexpected(now.error());
    if (as_json) {
      std::printf("%s\n", json_text(*now, -1).c_str());
    } else {
      if (is_terminal) std::printf("\033[H\033[2J");
      print_table(*now);
    }
    std::fflush(stdout);
    const auto next = Clock::now() + std::chrono::duration<double>(words.every);
    while (Clock::now() < next && !Interruption::requested())
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return {};
}

Status list_wearers(AdminClient* client, bool as_json) {
  const auto answer = client->ask({{"verb", "clients"}});
  if (!answer) return tl::unexpected(answer.error());
  std::map<std::string, json> wearers;
  for (const json& each : answer->content.value("clients", json::array())) {
    const std::string wearer = each.value("wearer", "");
    if (!wearer.empty()) wearers.try_emplace(wearer, json::array()).first->second.push_back(each);
  }
  json told = json::array();
  for (const auto& [wearer, cameras] : wearers) told.push_back({{"wearer", wearer}, {"cameras", cameras}});
  if (as_json) {
    std::printf("%s\n", json_text(told, 2).c_str());
    return {};
  }
  if (told.empty()) std::fprintf(stderr, "cairnctl: nobody wears a camera (`cairn-track --wearer NAME`)\n");
  for (const json& one : told) {
    std::printf("%s\n", text_of(one, "wearer").c_str());
    for (const json& camera : one["cameras"]) {
      const std::string map = text_of(camera, "map");
      std::printf("  %-32s %s%s%s\n", text_of(camera, "name").c_str(),
                  camera.value("connected", false) ? "connected" : "away", map.empty() ? "" : ", in ",
                  map.c_str());
    }
  }
  return {};
}

}  // namespace

void describe_watch(CLI::App* app, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* top = app->add_subcommand("top",
                                      "maps, clients, keyframes a minute, how long offers wait: a table that "
                                      "goes on until it is interrupted");
  top->add_flag("--once", words->once, "one table");
  top->add_option("--every", words->every, "seconds")->check(CLI::Range(0.2, 3600.0))->capture_default_str();
  top->callback([action, words] {
    *action = [words](AdminClient* client, bool as_json) {
      return words->once ? show_once(client, as_json) : show_on(client, *words, as_json);
    };
  });
  app->add_subcommand("wearers", "who wears which cameras, and where they are")->callback([action] {
    *action = list_wearers;
  });
}

}  // namespace cairn
