"""Whole missions: many inputs into one folder, resumed where they stopped.

One process, the keeper, writes all that is in the folder; workers only read inputs and hand back
bytes. What was finished is known from the manifest alone, so a batch may end at any moment:

    run.py            a batch from its inputs to the mission table
    inputs.py         what the files, folders, patterns and addresses of a command line stand for
    remote.py         those of a store such as s3://
    configuration.py  what decides on the numbers, in one hash
    manifest.py       the append-only list of what was done
    records.py        what the mission table is made of, in one append-only file
    files.py          writes that outlast a kill, a full disk and a loss of power
    folder.py         the folder: its lock, its files, each whole or as it was
    agenda.py         what is to be done for an input
    tasks.py          what a worker does
    child.py          a worker process, and what becomes of it when it dies or hangs
    pool.py           workers on this machine
    cluster.py        workers of Dask distributed
    keeper.py         from inputs to entries of the manifest
    mission.py        the table and the summary over all inputs
    arrivals.py       inputs that are still coming in
"""
