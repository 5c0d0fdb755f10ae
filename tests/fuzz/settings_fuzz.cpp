// SPDX-License-Identifier: Apache-2.0
//
// Settings that an operator writes or gets from elsewhere: profiles of the middleware and lists of wearers.
// The first byte says which.
#include "common/map/ids.h"
#include "common/wire/internal/configuration.h"
#include "server/service/wearer_list.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

void read_wearer_list(const MemoryFile& file) {
  const auto wearers = read_wearers(file.path());
  if (!wearers) return demand(!wearers.error().message.empty(), "a refusal has a reason");
  for (const auto& [client, wearer] : *wearers)
    demand(is_valid_name(client) && is_valid_name(wearer), "clients and wearers have names");
}

void read_middleware_profile(const MemoryFile& file) {
  const auto profile = wire::internal::read_profile(file.path());
  if (!profile) return demand(!profile.error().message.empty(), "a refusal has a reason");
  static_cast<void>(wire::internal::interface_of_profile(*profile));
  wire::ParticipantOptions options;
  options.profile = file.path();
  const wire::NetworkPath path{"127.0.0.1", "lo", "127.0.0.1"};
  demand(wire::internal::make_configuration(options, path, 0, nullptr).has_value(),
         "a profile that is read makes a configuration");
}

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  const MemoryFile file(bytes.subspan(1));
  bytes[0] % 2 == 0 ? read_wearer_list(file) : read_middleware_profile(file);
}

std::vector<Input> seeds() {
  std::vector<Input> all{
      input_of(0, "anna: [hand-1, shoulder-1]\nbob:\n  - phone-2\n"),
      input_of(1,
               "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"wlan0\" "
               "presence_required=\"false\"/></Interfaces></General></Domain></CycloneDDS>"),
      input_of(1,
               "<CycloneDDS><Domain><General><NetworkInterfaceAddress>192.168.1.2</NetworkInterfaceAddress>"
               "</General></Domain></CycloneDDS>")};
  for (const char* built_in : {"loopback", "wifi"}) {
    const auto text = wire::internal::read_profile(built_in);
    demand(text.has_value(), "a profile is built in");
    all.push_back(input_of(1, *text));
  }
  return all;
}

}  // namespace cairn::fuzz
