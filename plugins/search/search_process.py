"""The process that flies a search for another program: as that of a campaign."""

import sys

from wil_campaign.orchestrator.campaign.display_thread import DisplayThread
from wil_campaign.orchestrator.cli.arming_consent import REFUSED, FlightRefusedError
from wil_campaign.orchestrator.cli.engine_flight import check_engine, result_store
from wil_campaign.plugins.python.flight_messages import CampaignEnded, decode_request
from wil_campaign.plugins.python.flight_process import MessageWatcher, serve_flight_request
from wil_campaign.plugins.search.errors import SearchError
from wil_campaign.plugins.search.exploration.strategies import MissingExtraError
from wil_campaign.plugins.search.search_flight import fly_search_file, write_search_report


def main() -> int:
    """Fly the search that is requested on standard input."""
    return serve_flight_request(_fly_search)


def _fly_search(line: bytes, watcher: MessageWatcher) -> CampaignEnded:
    """Fly a requested search. Raises what `flight_process` reports."""
    request = decode_request(line)
    check_engine(request.options.engine)
    result_store(request.options)
    try:
        found, outcome = fly_search_file(
            request.file,
            request.choice.options(),
            request.options,
            lambda _: DisplayThread(watcher),
        )
    except (SearchError, MissingExtraError) as error:
        raise FlightRefusedError(str(error), REFUSED) from error
    write_search_report(found, outcome, watcher.say)
    return CampaignEnded(folder=str(outcome.folder), exit_code=outcome.exit_code)


if __name__ == "__main__":
    sys.exit(main())
