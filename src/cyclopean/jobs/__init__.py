"""What the commands do: read files, run the steps, write results, talk to the person."""
