// Reads a server of joining results with the client of node-opcua, and prints lines of JSON.
// usage: joining_client.js URL read RESULT...    prints the address space and these results
//        joining_client.js URL watch COUNT       prints [] when it watches, then COUNT events
const {
  OPCUAClient, AttributeIds, DataType, BrowseDirection, TimestampsToReturn, constructEventFilter,
} = require("node-opcua-client");

async function watch(session, namespaces, node, count) {
  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 50, requestedLifetimeCount: 1000, publishingEnabled: true,
  });
  const result = namespaces.indexOf("http://opcfoundation.org/UA/Machinery/Result/");
  const item = await subscription.monitor(
    { nodeId: node("ResultManagement"), attributeId: AttributeIds.EventNotifier },
    { queueSize: 100, filter: constructEventFilter(["Message", `${result}:Result`]) },
    TimestampsToReturn.Both);
  const seen = new Promise((resolve) => {
    let left = count;
    item.on("changed", (values) => {
      console.log(JSON.stringify(values.map((one) => one.value)));
      left -= 1;
      if (left === 0) resolve();
    });
  });
  console.log("[]");
  await seen;
  await subscription.terminate();
}

async function read(session, namespaces, node, results) {
  const browse = async (nodeId) => {
    const found = await session.browse({
      nodeId, browseDirection: BrowseDirection.Forward, includeSubtypes: true, resultMask: 63,
      referenceTypeId: "HierarchicalReferences",
    });
    return found.references.map((one) => [one.browseName.name, one.typeDefinition?.value ?? null]);
  };
  const values = {};
  for (const name of results) {
    const read = await session.read({ nodeId: node(name), attributeId: AttributeIds.Value });
    values[name] = read.value.value;
  }
  const call = async (method, inputArguments) => {
    const done = await session.call({
      objectId: node("ResultManagement"), methodId: node(method), inputArguments,
    });
    return done.outputArguments.map((one) => one.value);
  };
  const timeout = { dataType: DataType.Int32, value: 0 };
  const named = (value) => ({ dataType: DataType.String, value });
  const written = await session.write({
    nodeId: node(results[0]), attributeId: AttributeIds.Value,
    value: { value: { dataType: DataType.Int32, value: 1 } },
  }).then((status) => status.name, (error) => error.message);
  console.log(JSON.stringify({
    machines: await browse(`ns=${namespaces.indexOf("http://opcfoundation.org/UA/Machinery/")};i=1001`),
    system: await browse(node("axis")),
    management: await browse(node("ResultManagement")),
    results: await browse(node("Results")),
    values,
    latest: await call("GetLatestResult", [timeout]),
    unknown: await call("GetResultById", [named("none"), timeout]),
    written,
  }));
}

async function main(url, command, ...words) {
  const client = OPCUAClient.create({
    endpointMustExist: false,
    connectionStrategy: { maxRetry: 5, initialDelay: 200 },
  });
  await client.connect(url);
  const session = await client.createSession();
  const namespaces = await session.readNamespaceArray();
  const node = (name) => `ns=${namespaces.indexOf("urn:forceaxis:joining")};s=${name}`;
  if (command === "watch") await watch(session, namespaces, node, Number(words[0]));
  else await read(session, namespaces, node, words);
  await session.close();
  await client.disconnect();
}

main(...process.argv.slice(2)).then(
  () => process.exit(0),
  (error) => { console.error(error); process.exit(1); });
