"""What the plugin cluster adds."""

from wil_campaign.hooks import Command, Engine, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the commands of benches."""
    return (
        Command("bench", "", "Check files of benches, and serve one to a cluster.", "operate"),
        Command(
            "bench check",
            "wil_campaign.plugins.cluster.bench.bench_command:check",
            "Report every fault of bench files; nothing is connected to.",
        ),
        Command(
            "bench serve",
            "wil_campaign.plugins.cluster.bench.bench_command:serve",
            "Join a cluster, and fly its campaigns on a bench of this machine.",
        ),
    )


@implements
def engines() -> tuple[Engine, ...]:
    """Return the engine of Ray."""
    return (
        Engine(
            "ray",
            values="ray or ray://HOST:PORT",
            check="wil_campaign.plugins.cluster.ray_engine:engine_address",
            start="wil_campaign.plugins.cluster.cluster_engine:cluster_engine",
            on_bench="wil_campaign.plugins.cluster.bench.bench_flight:ready_on_bench",
            store="wil_campaign.plugins.cluster.cluster_engine:store_of_results",
            fetch="wil_campaign.plugins.cluster.unfetched_runs:fetch_stored_runs",
            help="ray, by a Ray started here for the campaign; ray://HOST:PORT, over the nodes of "
            "a Ray cluster that this machine is one of.\nIt needs the extra cluster, and "
            "ray:// a --store: file:///FOLDER that its nodes share, or s3://BUCKET/PREFIX.",
        ),
    )
